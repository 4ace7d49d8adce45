"""Outlines of short forms, and corners that make no polygon."""

from __future__ import annotations

import math
from typing import TypeAlias

import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from star_core.world.outlines import MIN_WIDTH, box, outline_fault
from star_yaml.world_loader import around_circle

Corner: TypeAlias = tuple[float, float]

metres = st.floats(-5, 5)
corners: st.SearchStrategy[Corner] = st.tuples(metres, metres)
sizes = st.floats(0.1, 3)


@given(corners, sizes, sizes, st.floats(-math.pi, math.pi))
def test_a_box_has_its_centre_its_size_and_its_turn(
    centre: Corner, length: float, width: float, yaw: float
) -> None:
    made = shapely.Polygon(box(centre, (length, width), yaw))
    level = shapely.affinity.rotate(made, -yaw, "centroid", use_radians=True)
    x, y = centre
    expected = (x - length / 2, y - width / 2, x + length / 2, y + width / 2)
    assert level.bounds == pytest.approx(expected, abs=1e-9)
    assert made.exterior.is_ccw


@given(corners, sizes)
def test_the_sides_of_a_cylinder_touch_its_circle_from_outside(
    centre: Corner, radius: float
) -> None:
    made = shapely.Polygon(around_circle(centre, radius))
    assert made.exterior.distance(shapely.Point(centre)) == pytest.approx(radius)
    assert shapely.hausdorff_distance(made.exterior, shapely.Point(centre)) < 1.01 * radius


@given(st.lists(st.tuples(st.integers(-4, 4), st.integers(-4, 4)), min_size=3, max_size=7))
def test_outlines_are_valid_exactly_if_the_polygon_is_simple(grid: list[tuple[int, int]]) -> None:
    ring = shapely.LinearRing(grid)
    assume(all(a != b for a, b in zip(grid, grid[1:] + grid[:1], strict=True)))
    assert (outline_fault(grid) is None) is (ring.is_simple and shapely.Polygon(grid).is_valid)


@pytest.mark.parametrize(
    ("corners", "fault"),
    [
        ([(0, 0), (0.1, 0.1), (0.3, 0.3)], "has all its points on one line"),
        ([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)], "crosses or touches itself at [1, 0]"),
        ([(0, 0), (2, 0), (1, 0), (1, 1)], "crosses or touches itself at [2, 0]"),
    ],
)
def test_what_is_no_polygon_is_reported_with_its_place(corners: list[Corner], fault: str) -> None:
    assert outline_fault(corners) == fault


@given(corners, st.floats(1.1 * MIN_WIDTH, 1), st.floats(1, 1000), st.floats(-math.pi, math.pi))
def test_nothing_is_refused_that_is_wider_than_the_least_width(
    centre: Corner, width: float, times: float, yaw: float
) -> None:
    assert outline_fault(box(centre, (times * width, width), yaw)) is None


def test_outlines_of_thousands_of_corners_are_checked_fast() -> None:
    ring = [(math.cos(math.tau * i / 5000), math.sin(math.tau * i / 5000)) for i in range(5000)]
    assert outline_fault(ring) is None
