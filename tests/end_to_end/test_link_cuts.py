"""No drone falls or stays in the air after its link was cut; `make link-cuts` flies all cells."""

from __future__ import annotations

import pytest

from tests.campaign.link_cuts import CELLS, Cell, cut_flight, excused

pytest.importorskip("cflib")

FEW: list[Cell] = [
    ("take-off", 1.5, False),
    ("take-off", 3.0, True),
    ("flight by setpoints", 1.7, True),
    ("landing", 1.5, True),
    ("on-board `follow`", 3.0, True),
]


def wrong(cell: Cell, seeds: range) -> list[tuple[int, str]]:
    """Return the seeds of flights in which a drone fell or stayed in the air, and how."""
    phase, length, whole = cell
    bad = []
    for seed in seeds:
        outcome = cut_flight(phase, length, whole=whole, seed=seed)
        if outcome.aloft or (outcome.fell and not excused(phase, length)):
            bad.append((seed, str(outcome)))
    return bad


@pytest.mark.parametrize("cell", FEW, ids=str)
def test_no_drone_falls_or_stays_in_the_air_after_a_cut(cell: Cell) -> None:
    assert wrong(cell, range(1)) == []


@pytest.mark.campaign
@pytest.mark.parametrize("cell", CELLS, ids=str)
def test_no_drone_falls_or_stays_in_the_air_after_ten_cuts(cell: Cell) -> None:
    assert wrong(cell, range(10)) == []
