"""The ground that obstacles take at a height."""

from __future__ import annotations

import math
from typing import TypeAlias

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from star_core.geometry.obstacles import OFFSET_RATIO, footprint
from star_core.world.outlines import box, wall
from star_core.world.world import Obstacle

Corner: TypeAlias = tuple[float, float]

SQUARE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
ROOM = (*SQUARE, SQUARE[0])


def thing(*polygons: tuple[Corner, ...], height: tuple[float, float] = (0.0, 2.0)) -> Obstacle:
    return Obstacle("thing", polygons, height)


@st.composite
def boxes(draw: st.DrawFn) -> Obstacle:
    place, size = st.floats(-3, 3), st.floats(0.1, 2)
    return thing(
        box((draw(place), draw(place)), (draw(size), draw(size)), draw(st.floats(0, math.pi)))
    )


crowds = st.lists(boxes(), min_size=1, max_size=5)


@given(crowds, st.floats(0.05, 1), st.tuples(st.floats(-6, 6), st.floats(-6, 6)))
def test_footprint_covers_the_clearance_and_little_more(
    crowd: list[Obstacle], clearance: float, at: Corner
) -> None:
    point = shapely.Point(at)
    away = min(shapely.Polygon(o.polygons[0]).distance(point) for o in crowd)
    covered = footprint(crowd, 1.0, 1.0, clearance).distance(point) == 0
    if away < clearance - 1e-8:
        assert covered
    if away > OFFSET_RATIO * clearance + 1e-8:
        assert not covered


@given(crowds, st.floats(0, 1))
def test_no_two_parts_touch_along_an_edge(crowd: list[Obstacle], clearance: float) -> None:
    parts = footprint(crowd, 1.0, 1.0, clearance).geoms
    whole = shapely.union_all(list(parts))
    assert shapely.get_num_geometries(whole) == len(parts)


def test_boxes_that_touch_are_one() -> None:
    pair = [thing(box((0, 0), (1, 1), 0)), thing(box((1, 0), (1, 1), 0))]
    (only,) = footprint(pair, 1.0, 1.0).geoms
    assert only.area == pytest.approx(2.0)
    assert len(only.exterior.coords) == 5


@pytest.mark.parametrize("clearance", [0.0, 0.3])
def test_the_room_inside_a_closed_wall_stays_hollow(clearance: float) -> None:
    (only,) = footprint([thing(*wall(ROOM, 0.2))], 1.0, 1.0, clearance).geoms
    (hole,) = only.interiors
    inside = 2 * (1 - 0.1 - OFFSET_RATIO * clearance)
    assert shapely.Polygon(hole).area == pytest.approx(inside**2)


def test_a_door_makes_the_room_a_part_of_the_outside() -> None:
    line = [(-0.5, -1), (-1, -1), (-1, 1), (1, 1), (1, -1), (0.5, -1)]
    (only,) = footprint([thing(*wall(line, 0.2))], 1.0, 1.0, 0.2).geoms
    assert not only.interiors


def test_a_door_that_is_too_narrow_is_closed() -> None:
    line = [(-0.5, -1), (-1, -1), (-1, 1), (1, 1), (1, -1), (0.5, -1)]
    (only,) = footprint([thing(*wall(line, 0.2))], 1.0, 1.0, 0.45).geoms
    assert len(only.interiors) == 1


@pytest.mark.parametrize(
    ("low", "high", "overlaps"),
    [(1.5, 1.5, True), (0.2, 1.1, True), (0.0, 1.0, False), (2.0, 3.0, False), (1.0, 1.0, False)],
)
def test_only_what_reaches_in_between_counts(low: float, high: float, *, overlaps: bool) -> None:
    shelf = thing(SQUARE, height=(1.0, 2.0))
    assert footprint([shelf], low, high).is_empty is not overlaps


def test_walls_below_numeric_resolution_are_still_obstacles() -> None:
    thin = thing(*wall([(0.0, 0.0), (1.0, 0.0)], 1e-300))
    only = footprint([thin], 1.0, 1.0, 0.2)
    assert only.contains(shapely.Point(0.5, 0.19))


def test_without_obstacles_the_ground_is_free() -> None:
    assert footprint([], 0.0, 2.0, 0.5).is_empty
