"""Which cells were seen, and which can be."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from star_core import Camera, Obstacle
from star_search.area import MIN_IMAGES, FieldOfView, field_of_view
from star_search.coverage_map import CoverageMap
from tests.plugins.tasks.star_search.conftest import hall

AREA = shapely.box(-2, -2, 2, 2)
VIEW = field_of_view(Camera(), 0.8, 0.168, 0.05)
WALL = (((-0.05, -1.5), (0.05, -1.5), (0.05, 1.5), (-0.05, 1.5)),)


def map_of(*obstacles: Obstacle, clearance: float = 0.0) -> CoverageMap:
    return CoverageMap(AREA, obstacles, (0, 1), cell=0.1, border=1.0, clearance=clearance)


def cells_at(coverage: CoverageMap, x: float, y: float) -> int:
    return int(np.argmin(((coverage.center - [x, y]) ** 2).sum(axis=1)))


def test_a_cell_is_seen_after_so_many_looks_of_one_agent() -> None:
    coverage = map_of()
    pose = np.array([0.0, 0.0, 0.0])
    for row in (0, 1, 0, 1):
        coverage.observe(row, VIEW, pose)
    assert not coverage.seen.any()
    assert MIN_IMAGES == 3
    coverage.observe(0, VIEW, pose)
    assert coverage.seen[cells_at(coverage, 0.75, 0.05)]
    assert not coverage.seen[cells_at(coverage, -0.75, 0.05)]


def test_the_share_that_is_covered_grows_to_one() -> None:
    coverage = map_of()
    assert coverage.fraction == 0.0
    coverage.seen[:-1] = True
    assert coverage.fraction == 1.0


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-4, 4))
def test_cells_in_view_are_where_the_view_is(x: float, y: float, yaw: float) -> None:
    coverage = map_of()
    (cells,) = coverage.visible(VIEW, np.array([[x, y, yaw]]))
    turn = complex(math.cos(yaw), math.sin(yaw))
    for cell, (ahead, left) in zip(cells.tolist(), VIEW.points, strict=True):
        point = complex(x, y) + turn * complex(ahead, left)
        if cell != coverage.outside:
            away = coverage.center[cell] - [point.real, point.imag]
            assert np.abs(away).max() <= 0.05 + 1e-9


def test_a_wall_hides_what_is_behind_it() -> None:
    pose = np.array([[-0.4, 0.0, 0.0]])
    high, low = (map_of(Obstacle("wall", WALL, (0.0, 2.0))), map_of(Obstacle("w", WALL, (0, 0.1))))
    behind = cells_at(high, 0.35, 0.05)
    assert behind not in high.visible(VIEW, pose)
    assert behind in low.visible(VIEW, pose)
    assert behind in map_of(Obstacle("table", WALL, (0.7, 0.9))).visible(VIEW, pose)


def test_floor_that_an_obstacle_stands_on_is_not_looked_for() -> None:
    standing, hanging = (map_of(Obstacle("a", WALL, (0, 1))), map_of(Obstacle("b", WALL, (0.5, 1))))
    under = cells_at(standing, 0.0, 0.0)
    assert not standing.required[under]
    assert hanging.required[under]


def test_a_rim_along_obstacles_is_not_looked_for() -> None:
    coverage = map_of(Obstacle("wall", WALL, (0.0, 2.0)), clearance=0.15)
    assert not coverage.required[cells_at(coverage, 0.15, 0.0)]
    assert coverage.required[cells_at(coverage, 0.25, 0.0)]


def test_cells_beside_others_share_a_side_with_them() -> None:
    coverage = map_of()
    some = np.zeros_like(coverage.seen)
    some[cells_at(coverage, 0.05, 0.05)] = True
    near = coverage.center[np.flatnonzero(coverage.adjacent(some))]
    assert sorted(map(tuple, near.round(2).tolist())) == [
        (-0.05, 0.05), (0.05, -0.05), (0.05, 0.15), (0.15, 0.05),
    ]  # fmt: skip


def test_an_agent_that_turns_fast_sees_nothing() -> None:
    from dataclasses import replace

    from star_core.testing import estimate
    from star_search.search_space import SearchSpace

    room = hall(1)
    space = SearchSpace(
        room, (0,), area=None, height=0.8, speed=0.3, lane_spacing=None, clearance=0.3
    )
    now = estimate(np.array([[-1.0, -1.0, 0.8]]))
    for tick in range(20):
        space.observe(replace(now, time=tick * 0.1, yaw=np.array([tick * 0.2])), (0,))
    # 2 rad/s; only the first look, before which nothing is known of the turn, counts
    assert space.coverage.fraction == 0.0
    for tick in range(20, 24):
        space.observe(replace(now, time=tick * 0.1, yaw=np.array([0.0])), (0,))
    assert space.coverage.fraction > 0.0


def test_a_view_of_nothing_shows_nothing() -> None:
    nothing = FieldOfView((0.0, 0.0, 0.8), (), 0.1)
    assert map_of().visible(nothing, np.zeros((2, 3))).shape == (2, 0)


@pytest.mark.parametrize("n", [0, 1, 200])
def test_many_poses_are_answered_as_one_by_one(n: int) -> None:
    coverage = map_of(Obstacle("wall", WALL, (0.0, 2.0)))
    pose = np.random.default_rng(n).uniform(-2, 2, (n, 3))
    together = coverage.visible(VIEW, pose)
    assert together.shape == (n, len(VIEW.points))
    alone = [coverage.visible(VIEW, row[None])[0].tolist() for row in pose]
    assert together.tolist() == alone
