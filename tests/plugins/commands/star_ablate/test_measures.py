"""Misspelt measures are refused before the first flight, or after it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from star_ablate.measures import offered, paths, undeclared
from star_core import Registry, fly, hookimpl, load
from star_core.commands.main import main
from tests.commands import Printed
from tests.plugins.commands.star_ablate.conftest import Write

HOP = "missions: [../hop.yaml]\nseeds: 3\nmeasures: "


class Heights:
    @hookimpl
    def star_summary(self) -> dict[str, Any]:
        return {"heights_m": {"mean": 0.5}}


class DeclaredHeights(Heights):
    @hookimpl
    def star_measures(self) -> Iterator[str]:
        yield "heights_m.mean"


def test_every_measure_that_is_offered_is_in_a_summary(hop: Path) -> None:
    registry = Registry()
    summary = fly(load(hop / "hop.yaml", registry), registry)
    measures = list(paths(summary))
    assert undeclared(measures, registry) == []
    for name in offered(registry):
        assert name.removesuffix(".*") in measures


@pytest.mark.parametrize("command", ["check", "ablate"])
def test_a_misspelt_measure_is_refused_before_a_flight(
    command: str, study: Write, capsys: Printed
) -> None:
    path = study(f"{HOP}[flight_time_s, min_seperation_m]\n")
    assert main([command, str(path)]) == 2
    assert (
        f"{path}:5:27: summaries have no measure 'min_seperation_m'; did you mean"
        " 'min_separation_m'? [unknown-measure]"
    ) in " ".join(capsys.readouterr().err.split())


def test_a_measure_of_no_resemblance_lists_those_there_are(study: Write, capsys: Printed) -> None:
    assert main(["ablate", str(study(f"{HOP}[energy_j]\n"))]) == 2
    assert "'energy_j'; there are" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("plugin", "measure", "status", "flown"),
    [
        (DeclaredHeights(), "heights_m.mean", 0, 3),
        (DeclaredHeights(), "heights_m.maen", 2, 0),
        (Heights(), "flight_time", 2, 1),  # it might be that of the plugin
        (Heights(), "path_length_m.total", 0, 3),
    ],
)
@pytest.mark.usefixtures("instant")
def test_measures_of_plugins_are_offered_or_tried(
    plugin: object,
    measure: str,
    status: int,
    flown: int,
    study: Write,
    tmp_path: Path,
    with_plugin: Callable[[object], None],
    capsys: Printed,
) -> None:
    with_plugin(plugin)
    out = tmp_path / "out"
    command = ["ablate", str(study(f"{HOP}[{measure}]\n")), "--quiet", "--out", str(out)]
    for _ in range(2):  # the second time it is refused without a flight
        assert main(command) == status
        assert (f"no measure {measure!r}; did you mean" in capsys.readouterr().err) == bool(status)
        journal = out / "runs.jsonl"
        assert (len(journal.read_text().splitlines()) if journal.exists() else 0) == flown
