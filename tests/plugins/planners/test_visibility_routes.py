"""Shortest paths among obstacles: as long as an independent search finds, never through one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import pytest
import shapely
from scipy.sparse.csgraph import shortest_path

from star_core import Array, Fence, Obstacle, Scene, World
from star_core.testing import scene
from star_core.toolkit import footprint
from star_core.world.outlines import box, wall
from star_visibility.routes import Routes
from tests.plugins.planners.test_visibility_heights import length, path_points

Corner: TypeAlias = tuple[float, float]

CLEARANCE, MARGIN = 0.2, 0.05
KEPT = CLEARANCE + MARGIN
LOW, HIGH = 0.2, 1.8  # the scene's limits


def room(*obstacles: Obstacle) -> Scene:
    return replace(
        scene(1), world=World("room", Fence((-5.0, -5.0, 0.0), (5.0, 5.0, 3.0)), obstacles)
    )


def block(
    centre: Corner, size: Corner, height: tuple[float, float] = (0.0, 3.0), yaw: float = 0.0
) -> Obstacle:
    return Obstacle("block", (box(centre, size, yaw),), height)


def barrier(line: Sequence[Corner], height: tuple[float, float] = (0.0, 3.0)) -> Obstacle:
    return Obstacle("wall", wall(line, 0.1), height)


def routes(*obstacles: Obstacle) -> Routes:
    return Routes(room(*obstacles), clearance=CLEARANCE, vertical_clearance=0.2, margin=MARGIN)


def brute_force(obstacles: Sequence[Obstacle], pairs: Array) -> Array:
    """Return the lengths of shortest paths among offset obstacles: all corners, all stretches.

    Every pair of corners is a stretch unless shapely says that it enters an obstacle, and scipy
    searches; infinity if there is no path.

    Args:
        obstacles: All that there are.
        pairs: (K, 2, 2) starts and goals.
    """
    ground = footprint(obstacles, 1.0, 1.0, KEPT)
    inside = ground.buffer(-1e-8, join_style="mitre")
    shapely.prepare(inside)
    point = np.vstack([shapely.get_coordinates(ground), pairs.reshape(-1, 2)])
    row, column = np.triu_indices(len(point), 1)
    line = np.array(shapely.linestrings(np.stack([point[row], point[column]], axis=1)))
    free = ~shapely.intersects(inside, line)
    weight = np.zeros((len(point), len(point)))
    weight[row[free], column[free]] = np.maximum(shapely.length(line[free]), 1e-12)
    starts = np.arange(len(point) - 2 * len(pairs), len(point), 2)
    ways = shortest_path(weight, directed=False, indices=starts)
    lengths: Array = ways[np.arange(len(pairs)), starts + 1]
    return lengths


def blob(random: np.random.Generator) -> Obstacle:
    """A polygon of 10 corners, seldom convex."""
    x, y = random.uniform(-4, 4, 2)
    angle = (np.arange(10) + random.uniform(0, 0.8, 10)) * math.tau / 10
    reach = random.uniform(0.2, 0.9, 10)
    corners = zip(x + reach * np.cos(angle), y + reach * np.sin(angle), strict=True)
    return Obstacle("blob", (tuple(corners),), (0.0, 3.0))


@pytest.mark.parametrize("seed", range(8))
def test_paths_are_as_long_as_those_of_an_independent_search(seed: int) -> None:
    random = np.random.default_rng(seed)
    blobs = [blob(random) for _ in range(9)]
    ground = footprint(blobs, 1.0, 1.0, KEPT)
    finder = routes(*blobs)
    drawn = random.uniform(-4.9, 4.9, (50, 2, 2))
    inside = np.array(ground.intersects(shapely.points(drawn)))
    pairs = drawn[~inside.any(axis=1)][:4]
    assert len(pairs) == 4
    for (start, goal), expected in zip(pairs, brute_force(blobs, pairs), strict=True):
        way = finder.route(np.array([*start, 1.0]), np.array([*goal, 1.0]))
        if isinstance(way, str):
            assert expected == math.inf
        else:
            assert length(np.vstack([[*start, 1.0], way])) == pytest.approx(expected, abs=1e-6)


def test_without_obstacles_the_path_is_straight() -> None:
    assert path_points(routes(), (-1, 0, 1), (1, 2, 1.5)).tolist() == [[-1, 0, 1], [1, 2, 1.5]]


def test_a_path_goes_round_the_nearer_side() -> None:
    way = path_points(routes(block((0, 0.5), (1, 2))), (-2, 0, 1), (2, 0, 1))
    assert way[1:-1, 1].max() == pytest.approx(-0.5 - KEPT, abs=0.02 * KEPT + 0.1)
    assert (way[1:-1, 1] < -0.5).all()


def test_a_path_finds_the_door_of_a_room() -> None:
    line = [(-0.5, -1.5), (-1.5, -1.5), (-1.5, 1.5), (1.5, 1.5), (1.5, -1.5), (0.5, -1.5)]
    way = path_points(routes(barrier(line)), (0, 3, 1), (0, 0, 1))
    through = shapely.LineString(way[:, :2]).intersection(
        shapely.LineString([(-0.5, -1.5), (0.5, -1.5)])
    )
    assert through.geom_type == "Point"


CLOSED = [(-1.5, -1.5), (-1.5, 1.5), (1.5, 1.5), (1.5, -1.5), (-1.5, -1.5)]


def test_inside_a_closed_room_one_can_fly() -> None:
    pillar = block((0, 0), (0.4, 0.4))
    way = path_points(routes(barrier(CLOSED), pillar), (-1, 0, 1), (1, 0, 1))
    assert np.abs(way[:, :2]).max() < 1.5


@pytest.mark.parametrize(
    ("start", "goal"), [((-3, 0, 1), (0, 0, 1)), ((0, 0, 1), (-3, 0, 1))], ids=["into", "out of"]
)
def test_no_way_leads_through_the_walls_of_a_closed_room(
    start: tuple[float, ...], goal: tuple[float, ...]
) -> None:
    why = routes(barrier(CLOSED)).route(np.array(start, float), np.array(goal, float))
    assert why == (f"no path leads from [{start[0]}, {start[1]}, 1] to [{goal[0]}, {goal[1]}, 1]")


def test_a_low_wall_is_flown_over_no_higher_than_it_takes() -> None:
    way = path_points(routes(barrier([(0, -5), (0, 5)], (0.0, 1.0))), (-2, 0, 0.8), (2, 0, 0.8))
    reach = 0.05 + KEPT
    assert way[:, 2].max() == pytest.approx(1.0 + KEPT)
    slope = math.hypot(2 - reach, 0.2 + KEPT)
    assert length(way) == pytest.approx(2 * reach + 2 * slope, abs=0.02)


def test_what_hangs_is_flown_under() -> None:
    way = path_points(routes(barrier([(0, -5), (0, 5)], (0.9, 3.0))), (-2, 0, 1.2), (2, 0, 1.2))
    assert way[:, 2].min() == pytest.approx(0.9 - KEPT)


def test_a_wall_is_flown_round_where_that_is_shorter() -> None:
    way = path_points(routes(barrier([(0, -0.2), (0, 5)], (0.0, 1.3))), (-2, 0, 0.5), (2, 0, 0.5))
    assert way[:, 2].tolist() == pytest.approx([0.5] * len(way))


def test_walls_too_near_the_highest_height_are_not_overflown() -> None:
    across = barrier([(0, -5), (0, 5)], (0.0, HIGH - KEPT + 0.01))
    assert isinstance(routes(across).route(np.array([-2.0, 0, 1]), np.array([2.0, 0, 1])), str)


def test_above_all_walls_one_flies_straight() -> None:
    way = path_points(routes(barrier([(0, -5), (0, 5)], (0.0, 1.0))), (-2, 0, 1.25), (2, 1, 1.4))
    assert len(way) == 2


def test_a_climb_beside_a_wall_is_straight() -> None:
    way = path_points(routes(block((0, 0), (1, 1))), (-1, 0, 0.3), (-1, 0, 1.7))
    assert way.tolist() == [[-1, 0, 0.3], [-1, 0, 1.7]]


def test_from_under_a_table_one_comes_onto_it() -> None:
    way = path_points(routes(block((0, 0), (1, 1), (0.7, 0.8))), (0, 0, 0.3), (0, 0, 1.2))
    assert 2 * (0.5 + KEPT) < length(way) < 2 * (0.5 + KEPT) + 1


def test_from_under_a_table_one_comes_over_a_wall() -> None:
    table = block((-1, 0), (1, 1), (1.1, 1.2))
    over = barrier([(0.5, -5), (0.5, 5)], (0.0, 0.8))
    way = path_points(routes(table, over), (-1, 0, 0.6), (2, 0, 0.6))
    assert way[:, 2].max() == pytest.approx(0.8 + KEPT, abs=0.2)


BLOCK = block((0, 0), (1, 1))


def test_what_is_too_near_above_is_named() -> None:
    low, aside = Obstacle("low", BLOCK.polygons, (0.0, 0.8)), block((2.0, 0), (1, 1))
    why = routes(aside, low).route(np.array([-3.0, 0, 1]), np.array([0.0, 0, 0.9]))
    assert why == (
        "[0, 0, 0.9] is 0.1 m above obstacle 'low', "
        "less than planner visibility's vertical clearance of 0.2 m"
    )


def test_routes_from_within_the_clearance_lead_out_first() -> None:
    way = path_points(routes(BLOCK), (0.3, 0.6, 1), (0, -2, 1))
    assert way[1] == pytest.approx([0.3, 0.5 + KEPT, 1], abs=0.02 * KEPT)


def test_from_just_above_a_block_the_shortest_way_out_is_up() -> None:
    low = block((0, 0), (2, 2), (0.0, 0.8))
    way = path_points(routes(low), (0, 0, 0.95), (3, 0, 0.4))
    assert way[1] == pytest.approx([0, 0, 0.8 + KEPT])


def test_an_agent_within_the_clearance_may_stay_where_it_is() -> None:
    beside, start, goal = routes(BLOCK), (0.0, 0.6, 1), (0.05, 0.62, 1)
    beside.allow_staying(np.array(start, float), np.array(goal, float))
    assert path_points(beside, start, goal).tolist() == [[0.0, 0.6, 1], [0.05, 0.62, 1]]


def test_the_way_out_does_not_lead_through_a_wall() -> None:
    cell = barrier([(0.0, -0.3), (0.0, 0.3), (3.0, 0.3), (3.0, -0.3), (0.0, -0.3)])
    why = routes(cell).route(np.array([0.15, 0.0, 1.0]), np.array([-2.0, 0, 1]))
    assert why == "no path leads out from [0.15, 0, 1], too near to obstacles all around"


def test_goals_within_the_margin_are_reached_the_shortest_way() -> None:
    way = path_points(routes(BLOCK), (0.0, -2, 1), (0.3, 0.72, 1))
    assert way[-1].tolist() == [0.3, 0.72, 1]
    assert way[-2] == pytest.approx([0.3, 0.5 + KEPT, 1], abs=0.02 * KEPT)
