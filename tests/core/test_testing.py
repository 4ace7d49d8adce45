"""The checks that authors of plugins run: parts that ship pass them, and violations are refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import ContractError, Estimate, Registry, Setpoint, fill_defaults
from star_core.testing import check_avoider, check_localizer, check_planner, scene


def made(kind: str, name: str, n: int) -> Any:
    spec = Registry().find(kind, name).offer
    return spec.make(scene(n), **fill_defaults({}, spec.options))


@pytest.mark.parametrize("n", [1, 3])
@pytest.mark.parametrize("name", ["none", "orca", "potential", "voronoi"])
def test_avoiders_that_ship_keep_their_contract(name: str, n: int) -> None:
    check_avoider(made("avoider", name, n), n)


@pytest.mark.parametrize("n", [1, 3])
@pytest.mark.parametrize("name", ["straight", "visibility"])
def test_planners_that_ship_keep_their_contract(name: str, n: int) -> None:
    check_planner(made("planner", name, n), n)


@pytest.mark.parametrize("n", [1, 3])
def test_the_localizer_flow_keeps_its_contract(n: int) -> None:
    check_localizer(made("localizer", "flow", n), n)


class Careless:
    """Mixes what is not known of one agent into what it answers for the others."""

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        return replace(wanted, velocity=wanted.velocity + estimate.position.sum())

    def plan(self, *_given: object) -> None: ...

    def locate(self, telemetry: Any) -> Any:
        answer = made("localizer", "flow", 3).locate(telemetry)
        return replace(answer, valid=np.ones(3, np.bool_), position=telemetry.position)


def test_violations_are_refused() -> None:
    with pytest.raises(ContractError, match=r"Setpoint.velocity of row 1 is \[nan"):
        check_avoider(Careless())
    with pytest.raises(ContractError, match="returned NoneType, expected Plan"):
        check_planner(Careless())  # type: ignore[arg-type]
    with pytest.raises(ContractError, match=r"Estimate.position of row 2 is \[nan"):
        check_localizer(Careless())
    with pytest.raises(ContractError, match=r"object has no avoid\(\)"):
        check_avoider(object())  # type: ignore[arg-type]
