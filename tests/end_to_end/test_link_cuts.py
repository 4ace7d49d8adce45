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


@pytest.mark.extended
@pytest.mark.parametrize(
    ("cell", "flights"),
    [
        *((cell, 1) for cell in FEW),
        *(pytest.param(cell, 10, marks=pytest.mark.campaign) for cell in CELLS),
    ],
    ids=str,
)
def test_no_drone_falls_or_stays_in_the_air_after_a_cut(cell: Cell, flights: int) -> None:
    phase, length, whole = cell
    for seed in range(flights):
        outcome = cut_flight(phase, length, whole=whole, seed=seed)
        assert not outcome.aloft, seed
        assert not outcome.fell or excused(phase, length), seed
