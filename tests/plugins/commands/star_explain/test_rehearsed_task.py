"""Tasks of plugins in a rehearsal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from star_core import PluginError, TaskSpec, hookimpl
from tests.plugins.commands.star_explain.conftest import Rehearse, Warn

MISSION = """\
star: 1
name: hum
world: hall.yaml
swarm: {cf1: {start: [0, 0, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: none
mission: [takeoff: {height: 0.8}, hum: {}]
"""


class Hum:
    """A verb whose step returns nothing."""

    @hookimpl
    def star_tasks(self) -> Iterable[TaskSpec]:
        yield TaskSpec(name="hum", summary="Hums.", make=self.make, options={})

    def make(self, _scene: object, _rows: object) -> Any:
        return self  # it is its own task

    def begin(self, estimate: object, health: object) -> float:
        return 5.0

    def step(self, estimate: object, health: object) -> None: ...


@pytest.mark.parametrize("method", ["make", "begin", "step"])
@pytest.mark.parametrize(
    ("error", "text"),
    [
        (RuntimeError("no"), "RuntimeError: no ("),
        (SystemExit("no"), "SystemExit: no ("),
        (PluginError("no camera", "missing-camera"), "no camera [missing-camera]"),
    ],
    ids=["raises", "exits", "raises STAR's own"],
)
def test_a_task_that_raises_is_a_warning_at_its_step(
    warn: Warn, monkeypatch: pytest.MonkeyPatch, method: str, error: BaseException, text: str
) -> None:
    def raises(*_arguments: object) -> Any:
        raise error

    hum = Hum()
    monkeypatch.setattr(hum, method, raises)
    (warning,) = warn(MISSION, plugins=(hum,))
    assert ":9:40: warning: hum fails in the rehearsal: task 'hum' (" in warning
    assert f":Hum): {text}" in warning
    assert warning.count("task 'hum'") == 1


def test_a_task_that_returns_nothing_fails_as_in_flight(rehearse: Rehearse) -> None:
    *_, hum = rehearse(MISSION, plugins=(Hum(),)).steps
    assert hum.outcome == "failed"
    assert hum.problem.startswith("task 'hum' (")
    assert hum.problem.endswith("returned NoneType, expected TaskOutput [contract-broken]")
