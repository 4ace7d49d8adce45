"""Ways over one thing and under the next: none is missed, and none leads through anything."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from star_core import Array, Fence, Limits, Obstacle, Scene, World
from star_core.testing import scene
from star_core.world.outlines import box, wall
from star_visibility.network import Work
from star_visibility.routes import Routes

CLEARANCE, MARGIN = 0.2, 0.05
KEPT = CLEARANCE + MARGIN
LOW, HIGH = 0.3, 1.8
HALF = 3.0  # m, half the room
CELL = 0.25  # m, of the coarse grid


def room(*obstacles: Obstacle) -> Scene:
    fence = Fence((-HALF, -HALF, 0.0), (HALF, HALF, 2.5))
    limits = Limits(height=(LOW, HIGH))
    return replace(scene(1), world=World("room", fence, obstacles), limits=limits)


def routes(*obstacles: Obstacle) -> Routes:
    scene = room(*obstacles)
    return Routes(scene, clearance=CLEARANCE, vertical_clearance=CLEARANCE, margin=MARGIN)


def barrier(x: float, height: tuple[float, float], end: float = HALF, name: str = "") -> Obstacle:
    """A wall across the room at x, from one side to y = `end`."""
    return Obstacle(name or f"wall {x:g}", wall([(x, -HALF), (x, end)], 0.1), height)


def path_points(routes: Routes, start: Sequence[float], goal: Sequence[float]) -> Array:
    """The points of a path, with its start."""
    origin = np.array(start, np.float64)
    way = routes.route(origin, np.array(goal, np.float64))
    assert not isinstance(way, str), way
    return np.vstack([origin, way])


def length(way: Array) -> float:
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def along(way: Array) -> Array:
    """Points on a path, 40 on each stretch."""
    share = np.linspace(0, 1, 40)[:, None, None]
    points: Array = (way[:-1] + share * (way[1:] - way[:-1])).reshape(-1, 3)
    return points


def gap(crowd: Sequence[Obstacle], point: Array) -> Array:
    """By how much each of (K, 3) points keeps the clearances and the margin, m."""
    spots = shapely.points(point[:, :2])
    gaps = [np.full(len(point), np.inf)]
    for thing in crowd:
        ground = shapely.union_all([shapely.Polygon(piece) for piece in thing.polygons])
        foot, top = thing.height
        above = np.maximum(foot - point[:, 2], point[:, 2] - top)
        gaps.append(np.maximum(shapely.distance(ground, spots), above) - KEPT)
    answer: Array = np.min(gaps, axis=0)
    return answer


LOW_WALL, HANGING = barrier(-0.8, (0.0, 1.0)), barrier(0.8, (0.7, 2.5))


def test_over_a_low_wall_and_under_a_hanging_one() -> None:
    way = path_points(routes(LOW_WALL, HANGING), (-2, 0, 0.5), (2, 0, 0.5))
    assert gap([LOW_WALL, HANGING], along(way)).min() > -1e-6
    assert way[:, 1] == pytest.approx(np.zeros(len(way)), abs=1e-6)
    wide = 0.05 + 1.02 * KEPT  # as far as arcs reach at most
    slope = math.hypot(1.6 - 2 * wide, 0.8)  # down from 1.25 m to 0.45 m between the two
    climb, rest = math.hypot(1.2 - wide, 0.75), math.hypot(1.2 - wide, 0.05)
    assert length(way) == pytest.approx(4 * wide + climb + slope + rest, abs=0.02)


def test_the_way_by_a_point_in_between_is_not_shorter() -> None:
    finder = routes(barrier(-0.8, (0.0, 1.0), 2.2), barrier(0.8, (0.7, 2.5), 2.2))
    start, between, goal = (-2, -2, 0.5), (0, -2, 0.5), (2, -2, 0.5)
    halves = length(path_points(finder, start, between)) + length(
        path_points(finder, between, goal)
    )
    assert length(path_points(finder, start, goal)) <= halves + 1e-9


def test_over_a_low_wall_and_through_a_door_under_a_lintel() -> None:
    sides = (wall([(0.5, -HALF), (0.5, -1.0)], 0.1)[0], wall([(0.5, 0.4), (0.5, HALF)], 0.1)[0])
    lintel = Obstacle("lintel", wall([(0.5, -1.0), (0.5, 0.4)], 0.1), (0.8, 2.5))
    world = LOW_WALL, Obstacle("sides", sides, (0.0, 2.5)), lintel
    way = path_points(routes(*world), (-2, 1.5, 0.5), (2, 1.5, 0.4))
    assert gap(world, along(way)).min() > -1e-6
    crossing = np.array([np.interp(0.5, way[:, 0], way[:, k]) for k in (1, 2)])
    assert -1.0 < crossing[0] < 0.4
    assert crossing[1] <= 0.8 - KEPT + 1e-6


def test_round_a_pillar_between_a_low_and_a_hanging_wall() -> None:
    pillar = Obstacle("pillar", (box((0.0, 0.0), (0.3, 1.0), 0.0),), (0.0, 2.5))
    world = LOW_WALL, pillar, HANGING
    way = path_points(routes(*world), (-2, 0, 0.5), (2, 0, 0.5))
    assert gap(world, along(way)).min() > -1e-6
    assert length(way) < 6.0


def test_what_is_closed_at_every_height_stays_closed() -> None:
    across = barrier(0.0, (0.0, 1.5))  # 1.75 m to fly over it, 1.3 m to fly under what hangs there
    above = barrier(0.2, (1.55, 2.5))
    why = routes(across, above).route(np.array([-2.0, 0, 0.5]), np.array([2.0, 0, 0.5]))
    assert why == "no path leads from [-2, 0, 0.5] to [2, 0, 0.5]"


@st.composite
def crowds(draw: st.DrawFn) -> list[Obstacle]:
    """Walls across the room and blocks, of all heights: they stand, hang and overlap."""
    heights = st.sampled_from(
        [(0.0, 2.5), (0.0, 0.6), (0.0, 1.0), (0.7, 2.5), (1.2, 2.5), (0.8, 1)]
    )
    place, size = st.floats(-2.5, 2.5), st.floats(0.1, 2)
    across = [
        barrier(draw(place), draw(heights), draw(st.sampled_from([HALF, HALF, 1.5])))
        for _ in range(draw(st.integers(1, 3)))
    ]
    return across + [
        Obstacle(
            f"block {k}",
            (box((draw(place), draw(place)), (draw(size), draw(size)), draw(st.floats(0, 3))),),
            draw(heights),
        )
        for k in range(draw(st.integers(0, 3)))
    ]


places = st.tuples(st.floats(-2.9, 2.9), st.floats(-2.9, 2.9), st.floats(LOW, HIGH))


def grid_finds_a_way(crowd: Sequence[Obstacle], start: Array, goal: Array) -> bool:
    """Whether a coarse search by steps along the axes gets from near the start to near the goal.

    Each step of it is free, with a little to spare.
    """
    across = np.arange(-HALF + CELL / 2, HALF, CELL)
    up = np.arange(LOW, HIGH + 1e-9, 0.125)
    node = np.stack(np.meshgrid(across, across, up, indexing="ij"), axis=-1)
    free = (gap(crowd, node.reshape(-1, 3)) > 0.03).reshape(node.shape[:3])
    steps = []
    for axis in range(3):
        upper = [slice(None)] * 3
        upper[axis] = slice(1, None)
        lower = [slice(None)] * 3
        lower[axis] = slice(None, -1)
        a, b = node[tuple(upper)].reshape(-1, 3), node[tuple(lower)].reshape(-1, 3)
        open_ = np.ones(len(a), np.bool_)
        for share in (0.25, 0.5, 0.75):
            open_ &= gap(crowd, a + share * (b - a)) > 0.03
        steps.append(open_.reshape(node[tuple(upper)].shape[:3]))
    ends = [
        {tuple(k) for k in np.argwhere(
            free & (np.abs(node - end) <= [CELL, CELL, 0.125]).all(axis=-1)
        ).tolist() if gap(crowd, along(np.array([end, node[tuple(k)]]))).min() > 0.0}
        for end in (start, goal)
    ]  # fmt: skip
    queue, visited = deque(ends[0]), set(ends[0])
    while queue:
        cell = queue.popleft()
        if cell in ends[1]:
            return True
        for axis in range(3):
            for move in (-1, 1):
                to = list(cell)
                to[axis] += move
                neighbour = tuple(to)
                if (
                    neighbour in visited
                    or not 0 <= to[axis] < free.shape[axis]
                    or not free[neighbour]
                ):
                    continue
                if steps[axis][min(cell, neighbour)]:
                    visited.add(neighbour)
                    queue.append(neighbour)
    return False


def both_agree(crowd: list[Obstacle], start: Sequence[float], goal: Sequence[float]) -> bool:
    """Whether a way was found; it is free, and none is missed that a coarse grid finds."""
    ends = np.array([start, goal])
    way = routes(*crowd).route(*ends)
    if isinstance(way, str):
        assert not grid_finds_a_way(crowd, *ends), way
        return False
    line = along(np.vstack([start, way]))
    assert gap(crowd, line).min() > -1e-6
    assert (np.abs(line[:, :2]) <= HALF + 1e-9).all()
    assert ((line[:, 2] >= LOW - 1e-9) & (line[:, 2] <= HIGH + 1e-9)).all()
    return True


@given(crowds(), places, places)
def test_routes_are_free_and_as_complete_as_a_grid_search(
    crowd: list[Obstacle], start: tuple[float, ...], goal: tuple[float, ...]
) -> None:
    assume((gap(crowd, np.array([start, goal])) > 0.03).all())
    both_agree(crowd, start, goal)


@given(crowds(), places, places)
def test_the_way_back_is_as_long(
    crowd: list[Obstacle], start: tuple[float, ...], goal: tuple[float, ...]
) -> None:
    assume((gap(crowd, np.array([start, goal])) > 0.03).all())
    finder = routes(*crowd)
    forth, back = (
        finder.route(np.array(a), np.array(b)) for a, b in ((start, goal), (goal, start))
    )
    assert isinstance(forth, str) is isinstance(back, str)
    if not isinstance(forth, str) and not isinstance(back, str):
        assert length(np.vstack([start, forth])) == pytest.approx(
            length(np.vstack([goal, back])), abs=1e-6
        )


@pytest.mark.campaign
@settings(max_examples=1500)
@given(crowds(), places, places)
def test_the_same_at_length(
    crowd: list[Obstacle], start: tuple[float, ...], goal: tuple[float, ...]
) -> None:
    assume((gap(crowd, np.array([start, goal])) > 0.03).all())
    both_agree(crowd, start, goal)


# In portions


def crowded() -> Scene:
    """A room that a wall cuts in two, with blocks of all heights on both sides."""
    random = np.random.default_rng(4)
    blocks = [
        Obstacle(
            f"block {k}",
            (
                box(
                    random.uniform(-2.5, 2.5, 2).tolist(),
                    random.uniform(0.2, 0.6, 2).tolist(),
                    float(k),
                ),
            ),
            (foot := float(random.choice([0.0, random.uniform(0.3, 1.5)])), foot + 0.4),
        )
        for k in range(16)
    ]
    across = Obstacle("across", wall([(0.0, -HALF), (0.0, HALF)], 0.1), (0.0, 2.5))
    return room(*blocks, across)


ASKED = np.array([-2.9, 2.9, 1.0]), np.array([2.9, -2.9, 1.0])


def test_a_search_in_portions_finds_what_one_in_one_go_finds() -> None:
    finder = Routes(crowded(), clearance=CLEARANCE, vertical_clearance=CLEARANCE, margin=MARGIN)
    start, goal = np.array([-2.9, 2.9, 0.4]), np.array([-0.4, -2.9, 0.4])
    work, portions = Work(50), list[Array | str]()
    search = finder.search(start, goal, work)
    while not (portions and len(portions[-1])):
        work.left = 50
        portions.append(portion(search))
    assert len(portions) > 5
    assert np.array_equal(portions[-1], finder.route(start, goal))


def portion(search: Iterator[None]) -> Array | str:
    """What a search finds before its work is used up; nothing if that is too early."""
    try:
        next(search)
    except StopIteration as end:
        path: Array | str = end.value
        return path
    return ""


@pytest.mark.parametrize("most", [1_000, 10_000])
def test_a_portion_is_no_more_than_was_allowed_and_one_step(most: int) -> None:
    finder = Routes(crowded(), clearance=CLEARANCE, vertical_clearance=CLEARANCE, margin=MARGIN)
    work, over = Work(most), list[int]()
    for _ in finder.search(*ASKED, work):
        over.append(-work.left)
        work.left = most
    assert len(over) > 10
    assert max(over) < 6_000
