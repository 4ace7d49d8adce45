"""The patterns: what they cover, how they share it, and that they come to an end."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely

from star_core import Obstacle, Status
from star_core.toolkit import fill_defaults
from star_search.frontier import Frontier, Viewpoints
from star_search.pattern import Pattern
from star_search.search_space import SearchSpace
from star_search.sweep import Sweep
from tests.plugins.tasks.star_search.conftest import PERIOD, SPEC, hall, search

both = pytest.mark.parametrize("pattern", ["sweep", "frontier"])
WALL = Obstacle("wall", (((-0.05, -2.0), (0.05, -2.0), (0.05, 2.0), (-0.05, 2.0)),), (0.0, 2.5))


def field_of(scene: Any, rows: tuple[int, ...] = (0, 1)) -> SearchSpace:
    return SearchSpace(
        scene, rows, area=None, height=0.8, speed=0.3, lane_spacing=None, clearance=0.3
    )


@pytest.mark.parametrize("pattern", [Sweep, Frontier])
def test_both_keep_the_contract(pattern: Any) -> None:
    assert isinstance(pattern(field_of(hall())), Pattern)


def covering(pattern: str, agents: int = 2, **options: Any) -> Any:
    """The search of a hall with an obstacle."""
    return _covering(pattern, agents, tuple(options.items()))


@cache
def _covering(pattern: str, agents: int, options: tuple[tuple[str, Any], ...]) -> Any:
    return search(hall(agents), pattern=pattern, **dict(options))


@both
def test_an_area_with_an_obstacle_is_covered_in_time_clear_of_it_and_of_the_fence(
    pattern: str,
) -> None:
    flown = covering(pattern)
    assert flown.status is Status.SUCCESS
    assert flown.space.coverage.fraction >= 0.99
    assert flown.time < flown.limit / 2
    goals = np.array(flown.goal)[:, :, :2].reshape(-1, 2)
    points = shapely.points(goals[np.isfinite(goals).all(axis=1)])
    block = shapely.box(-0.4, -0.4, 0.4, 0.4)
    assert shapely.distance(block, points).min() >= 0.3 - 1e-6
    assert shapely.box(-1.7, -1.7, 1.7, 1.7).buffer(1e-6).contains(points).all()


@pytest.mark.extended
@both
def test_more_scouts_are_done_sooner(pattern: str) -> None:
    assert covering(pattern, 3).time < 0.7 * covering(pattern, 1).time


@both
def test_the_share_of_a_scout_that_leaves_goes_to_the_others(pattern: str) -> None:
    def meddle(time: float, task: Any, scouts: Any) -> None:
        if time == 5.0:
            task.on_agents_removed((0,))
            scouts.phase = np.array([scouts.phase[0], 6])

    flown = search(hall(2), pattern=pattern, meddle=meddle)
    assert flown.status is Status.SUCCESS
    assert flown.space.coverage.fraction >= 0.99
    assert np.isnan(flown.goal[-1][1]).all()


@both
def test_a_replacement_continues_the_share_of_a_scout(pattern: str) -> None:
    fractions = []

    def meddle(time: float, task: Any, _scouts: Any) -> None:
        fractions.append(task._space.coverage.fraction)
        if time == 8.0:
            task.on_agent_replaced(1, 2)

    flown = search(hall(3), rows=(0, 1), pattern=pattern, meddle=meddle)
    assert flown.status is Status.SUCCESS
    assert fractions == sorted(fractions)
    goals = np.isfinite(np.array(flown.goal)).all(axis=2)  # (T, N)
    assert goals[:75, 1].any()
    assert not goals[81:, 1].any()
    assert goals[81:, 2].any()


@both
def test_a_scout_may_come_when_the_search_is_under_way(pattern: str) -> None:
    def meddle(time: float, task: Any, _scouts: Any) -> None:
        if time == 5.0:
            task.on_agents_added((0, 1))

    flown = search(hall(2), rows=(0,), pattern=pattern, meddle=meddle)
    assert flown.status is Status.SUCCESS
    assert flown.time < covering(pattern, rows=(0,)).time


@both
def test_a_scout_that_is_not_located_for_a_while_comes_back(pattern: str) -> None:
    def meddle(time: float, _task: Any, scouts: Any) -> None:
        scouts.valid = np.array([True, not 5.0 <= time < 10.0])

    flown = search(hall(2), pattern=pattern, meddle=meddle)
    assert flown.status is Status.SUCCESS
    assert np.isnan(np.array(flown.goal)[round(7.0 / PERIOD), 1]).all()
    assert np.isfinite(np.array(flown.goal)[round(15.0 / PERIOD), 1]).all()


@both
def test_only_the_area_is_searched(pattern: str) -> None:
    area = {"low": [-1.9, -1.9], "high": [-0.9, 0.0]}
    flown = search(hall(2), pattern=pattern, area=area)
    assert flown.status is Status.SUCCESS
    assert flown.time < 25.0
    assert flown.track[:, :, 0].max() < 0.5


@both
def test_invisible_floor_is_not_required(pattern: str) -> None:
    room = hall(1, obstacles=(WALL,))
    flown = search(room, pattern=pattern)
    assert flown.status is Status.SUCCESS
    assert flown.track[:, :, 0].max() < 0.0
    assert flown.space.coverage.center[np.flatnonzero(flown.space.coverage.required), 0].max() < 0.0


@both
def test_each_side_of_a_wall_is_searched_by_the_agents_there(pattern: str) -> None:
    flown = search(hall(4, half=2.0, obstacles=(WALL,)), pattern=pattern)
    assert (flown.track[0, :, 0] < 0).tolist() == [True, True, True, False]
    assert flown.status is Status.SUCCESS
    assert flown.space.coverage.fraction >= 0.99


def test_two_scouts_do_not_go_to_see_the_same() -> None:
    from star_core.testing import estimate

    room = hall(2)
    frontier = Frontier(field_of(room))
    now = estimate(np.array([[*agent.start[:2], 0.8] for agent in room.agents]))
    frontier.begin(now, (0, 1))
    frontier.waypoints(now, (0, 1))
    first, second = (set(trip.cells.tolist()) for trip in frontier._trips.values())
    assert first
    assert second
    assert not first & second


def test_a_viewpoint_is_as_far_as_the_way_around_an_obstacle() -> None:
    wall = Obstacle("wall", (((-0.05, -2.0), (0.05, -2.0), (0.05, 1.0), (-0.05, 1.0)),), (0.0, 2.5))
    space = field_of(hall(2, obstacles=(wall,)))
    points = Viewpoints(space, space.safe_views[0])
    way = points.distance(np.array([-1.0, -1.0, 0.8]))
    behind = np.argmin(np.hypot(points.pose[:, 0] - 1.0, points.pose[:, 1] + 1.0))
    assert 2 * np.hypot(1.0, 2.3) <= way[behind] <= 1.25 * 2 * np.hypot(1.0, 2.3)


def test_a_cell_that_cannot_be_seen_though_it_should_is_given_up() -> None:
    def meddle(_time: float, task: Any, _scouts: Any) -> None:
        coverage = task._space.coverage
        for looks in coverage._images.values():
            looks[:-1][np.hypot(*(coverage.center - [1.0, 1.0]).T) < 0.15] = 0

    room = replace(hall(2), period=0.1)  # ends near the cell
    flown = search(room, pattern="frontier", coverage=1.0, meddle=meddle)
    assert flown.status is Status.SUCCESS
    assert flown.space.coverage.unseen.any()
    assert np.hypot(*(flown.track[-1, :, :2] - [1.0, 1.0]).T).min() < 1.2  # it was looked for


def test_a_longer_way_has_more_time() -> None:
    small, large = (search(hall(2, half=half), longest=0.1) for half in (1.5, 4.0))
    assert large.limit > 3 * small.limit


def test_an_area_without_room_for_lanes_is_over_at_once() -> None:
    corner = {"low": [-0.3, -0.3], "high": [0.3, 0.3]}  # all of it is under the block
    assert search(hall(1), area=corner).status is Status.SUCCESS


def test_making_a_search_plans_nothing_that_flies() -> None:
    task: Any = SPEC.make(hall(2), (0, 1), **fill_defaults({}, SPEC.options))
    assert task._space.coverage.fraction == 0.0
