"""Positions for several agents that are sent to one point."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_verbs.positions import points_between, spread

sizes = st.integers(1, 60)
lengths = st.floats(0.1, 5.0)
coordinates = st.floats(-100.0, 100.0)
centres = st.tuples(coordinates, coordinates, coordinates)


@given(sizes, centres, lengths)
def test_no_two_positions_are_closer_than_the_spacing(
    n: int, centre: tuple[float, float, float], spacing: float
) -> None:
    for point, other in itertools.combinations(spread(n, centre, spacing), 2):
        assert math.dist(point, other) >= spacing * (1 - 1e-9)


@given(sizes, centres, lengths)
def test_the_positions_are_centred_on_the_goal(
    n: int, centre: tuple[float, float, float], spacing: float
) -> None:
    positions = spread(n, centre, spacing)
    mean = [math.fsum(values) / n for values in zip(*positions, strict=True)]
    assert mean == pytest.approx(centre, abs=1e-6)
    assert {z for _, _, z in positions} == {centre[2]}


@given(sizes.filter(lambda n: n > 1), lengths)
def test_the_positions_are_compact(n: int, spacing: float) -> None:
    # A disc of hexagons of the same area is this wide; no pattern of few points is much wider.
    radius = spacing * math.sqrt(n * math.sqrt(3) / (2 * math.pi))
    for x, y, _ in spread(n, (0.0, 0.0, 0.0), spacing):
        assert math.hypot(x, y) <= radius + 0.5 * spacing


@pytest.mark.parametrize(("n", "distances"), [(1, [0]), (2, [0.5] * 2), (3, [0.577] * 3)])
def test_few_agents_surround_the_goal(n: int, distances: list[float]) -> None:
    radii = [math.hypot(x, y) for x, y, _ in spread(n, (0, 0, 0), 1.0)]
    assert radii == pytest.approx(distances, abs=1e-3)


def test_seven_agents_make_a_ring_around_one() -> None:
    radii = sorted(math.hypot(x, y) for x, y, _ in spread(7, (0, 0, 0), 1.0))
    assert radii == pytest.approx([0.0] + [1.0] * 6)


@given(centres, centres, st.floats(0.05, 3))
def test_points_between_leave_no_gap_and_reach_both_ends(
    start: tuple[float, float, float], end: tuple[float, float, float], step: float
) -> None:
    points = list(points_between(start, end, step))
    assert points[0] == pytest.approx(start)
    assert points[-1] == pytest.approx(end)
    assert all(math.dist(a, b) <= step + 1e-9 for a, b in itertools.pairwise(points))
