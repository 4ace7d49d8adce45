"""Lanes over an area, a tour along them, and shares of it."""

from __future__ import annotations

import math
from itertools import chain
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from star_search.lanes import Lane, angles, assign_sections, divide, length, parallel_lanes, tour

ROOM = shapely.box(0, 0, 6, 4)
FREE = shapely.box(0.3, 0.3, 5.7, 3.7)
HOLE = shapely.box(2, 1.5, 3, 2.5)
ORIGIN = np.zeros(2)
somewhere = st.tuples(st.floats(0, 6), st.floats(0, 4))
spacings = st.floats(0.4, 2.0)


def lanes_of(area: Any, free: Any, spacing: float, angle: float = 0.0) -> list[Lane]:
    return list(chain.from_iterable(parallel_lanes(area, free, spacing, angle)))


def line(lane: Lane) -> Any:
    return shapely.LineString([lane.start, lane.end])


@given(somewhere, spacings, st.sampled_from([0.0, math.pi / 2]))
def test_every_point_is_within_half_a_spacing_of_a_lane(
    point: tuple[float, float], spacing: float, angle: float
) -> None:
    """But for the rim where no agent may be."""
    lanes = lanes_of(ROOM, FREE, spacing, angle)
    away = min(shapely.distance(line(lane), shapely.Point(point)) for lane in lanes)
    assert away <= max(spacing / 2, 0.3 * math.sqrt(2)) + 0.1


@given(spacings, st.floats(0, math.pi))
def test_lanes_lie_where_agents_may_be(spacing: float, angle: float) -> None:
    free = FREE.difference(HOLE)
    for lane in lanes_of(ROOM, free, spacing, angle):
        assert free.buffer(1e-6).contains(line(lane))


def test_lanes_are_as_many_as_it_takes_and_evenly_spread() -> None:
    lanes = lanes_of(ROOM, ROOM, 1.5)
    assert [round(float(lane.start[1]), 3) for lane in lanes] == [0.667, 2.0, 3.333]


def test_a_room_without_obstacles_is_one_group() -> None:
    assert [len(group) for group in parallel_lanes(ROOM, FREE, 1.0, 0.0)] == [4]


def test_an_obstacle_makes_four_groups() -> None:
    groups = parallel_lanes(ROOM, ROOM.difference(HOLE), 0.5, 0.0)
    assert sorted(len(group) for group in groups) == [2, 2, 3, 3]


def test_an_area_without_free_space_has_no_lanes() -> None:
    assert parallel_lanes(ROOM, shapely.box(10, 10, 12, 12), 1.0, 0.0) == []
    assert tour([], ORIGIN) == []


@given(somewhere, spacings)
def test_a_tour_flies_every_lane_once(start: tuple[float, float], spacing: float) -> None:
    groups = parallel_lanes(ROOM, ROOM.difference(HOLE), spacing, 0.0)
    flown = tour(groups, np.array(start))
    ends = [sorted([tuple(lane.start), tuple(lane.end)]) for lane in flown]
    assert sorted(ends) == sorted(
        sorted([tuple(lane.start), tuple(lane.end)]) for group in groups for lane in group
    )


def test_a_tour_goes_to_and_fro() -> None:
    flown = tour(parallel_lanes(ROOM, ROOM, 1.0, 0.0), ORIGIN)
    assert [bool(lane.end[0] > lane.start[0]) for lane in flown] == [True, False, True, False]
    assert flown[0].start[1] < flown[1].start[1]
    assert length(flown) == pytest.approx(4 * 6 + 3 * 1, abs=0.05)


def test_directions_are_those_of_the_sides_the_longest_first() -> None:
    assert angles(ROOM) == pytest.approx([0.0, math.pi / 2], abs=1e-6)


@given(st.integers(1, 6), spacings)
def test_shares_add_up_to_the_lanes_and_are_balanced(shares: int, spacing: float) -> None:
    lanes = tour(parallel_lanes(ROOM, ROOM.difference(HOLE), spacing, 0.0), ORIGIN)
    pieces = divide(lanes, shares)
    assert len(pieces) == shares
    total = sum(lane.length for piece in pieces for lane in piece)
    assert total == pytest.approx(sum(lane.length for lane in lanes), abs=1e-6)
    assert max(map(length, pieces)) <= length(lanes) / shares + 0.1


def test_nothing_is_cut_into_empty_shares() -> None:
    assert divide([], 3) == [[], [], []]


def test_agents_get_the_nearest_piece_from_its_near_end() -> None:
    west = [Lane(np.array([0.0, 0.0]), np.array([1.0, 0.0]))]
    east = [Lane(np.array([5.0, 0.0]), np.array([6.0, 0.0]))]
    sections = assign_sections([west, east], np.array([[6.0, 1.0], [0.0, 1.0]]))
    assert sections[0][0].start.tolist() == [6.0, 0.0]
    assert sections[1][0].start.tolist() == [0.0, 0.0]
