"""The verb ``formation`` as it is flown."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from star_core import AgentPhase, Array, Scene, Status, Task
from star_core.testing import estimate, health, scene
from star_core.toolkit import fill_defaults
from star_verbs.formation.spec import OPTIONS, make
from tests.plugins.tasks.conftest import Changing, fly

AIR = [[-1.0, 0.0, 0.8], [0.0, 0.0, 0.8], [1.0, 0.0, 0.8]]
ROOM = scene(3)
LINE: dict[str, Any] = {"shape": "line", "centre": [0.0, 2.0, 1.0], "spacing": 0.5}
MOVED: dict[str, Any] = {**LINE, "move": {"to": [3.0, 2.0, 1.0], "speed": 0.3}}
ONE_SECOND: dict[str, Any] = {"for": 1.0}
TWO_SECONDS: dict[str, Any] = {"for": 2.0}
THREE_SECONDS: dict[str, Any] = {"for": 3.0}


def task(room: Scene = ROOM, crew: tuple[int, ...] = (0, 1, 2), **options: Any) -> Task:
    return make(room, crew, **fill_defaults(options, OPTIONS))


@cache
def formed() -> Any:
    return fly(task(**LINE), ROOM, AIR)


@cache
def moved() -> Any:
    return fly(task(**MOVED), ROOM, AIR)


def apart(track: Array) -> Array:
    """(T, 2) distances from the first agent to the others."""
    distance: Array = np.linalg.norm(track[:, 1:] - track[:, :1], axis=2)
    return distance


def test_every_agent_flies_to_a_position_and_keeps_its_heading() -> None:
    flown = formed()
    assert flown.status is Status.SUCCESS
    assert flown.end == pytest.approx(np.array([[x, 2.0, 1.0] for x in (-0.5, 0, 0.5)]), abs=0.1)
    assert flown.yaw[-1].tolist() == [0.0, 0.0, 0.0]


def test_agents_are_assigned_positions_of_least_total_distance() -> None:
    flown = fly(task(**LINE), ROOM, [AIR[2], AIR[0], AIR[1]])
    assert flown.end[:, 0] == pytest.approx([0.5, -0.5, 0.0], abs=0.1)


def test_agents_turn_with_the_formation() -> None:
    flown = fly(task(**LINE, yaw_deg=90, **TWO_SECONDS), ROOM, AIR)
    assert flown.yaw[-1] == pytest.approx([math.pi / 2] * 3)
    assert np.ptp(flown.end[:, 0]) < 0.2
    assert np.ptp(flown.end[:, 1]) == pytest.approx(1.0, abs=0.2)


def test_a_grid_of_one_row_is_a_line() -> None:
    flown = fly(task(shape="grid", centre=[0.0, 2.0, 1.0], rows=1), ROOM, AIR)
    assert flown.end[:, 0] == pytest.approx([-0.6, 0.0, 0.6], abs=0.1)


def test_a_formation_is_held_from_when_it_is_formed() -> None:
    flown = fly(task(**LINE, **THREE_SECONDS), ROOM, AIR)
    assert flown.time == pytest.approx(formed().time + 3.0)


def test_a_formation_moves_to_its_goal_at_its_speed_and_in_shape() -> None:
    flown = moved()
    assert flown.status is Status.SUCCESS
    assert flown.end.mean(axis=0) == pytest.approx([3.0, 2.0, 1.0], abs=0.1)
    assert flown.time - formed().time == pytest.approx(3.0 / 0.3, abs=1.0)
    distance = apart(flown.track)[len(formed().track) :]
    assert len(distance) > 150  # ticks: it did move
    assert distance == pytest.approx(np.broadcast_to([0.5, 1.0], distance.shape), abs=0.05)


def test_a_formation_waits_for_an_agent_that_is_held_up() -> None:
    begun = formed().time

    def stuck(time: float) -> Any:
        return np.array([False, begun + 1 < time < begun + 9, False])

    flown = fly(task(**MOVED), ROOM, AIR, stuck=stuck)
    assert flown.status is Status.SUCCESS
    assert abs(apart(flown.track)[round(begun * 20) :] - [0.5, 1.0]).max() < 0.45


def test_an_agent_that_is_stuck_lets_it_not_be_formed() -> None:
    stuck = lambda _: np.array([True, False, False])  # noqa: E731 -- read with the call
    longest = formed().time + 10.0
    assert fly(task(**LINE), ROOM, AIR, stuck=stuck, longest=longest).status is Status.RUNNING


def test_its_timeout_is_by_its_ways_its_time_and_a_crossing() -> None:
    near: dict[str, Any] = {
        **MOVED,
        "centre": [0.0, 0.0, 0.8],
        "move": {"to": [3.0, 0.0, 0.8], "speed": 0.3},
    }
    limit = fly(task(**near, **TWO_SECONDS), ROOM, AIR, longest=0.1).limit
    crossing = math.dist(ROOM.world.fence.low, ROOM.world.fence.high) / ROOM.limits.speed
    assert limit == pytest.approx(3 * (0.5 / 0.5 + 3.0 / 0.3 + 2.0) + 5 + crossing)


def test_a_formation_that_fewer_agents_cannot_fly_fails() -> None:
    flown = fly(task(shape="line", centre=[9.8, 0.0, 1.0]), ROOM, AIR)
    assert flown.status is Status.FAILURE
    assert flown.reason.startswith("position 3 of 3: [10.4, 0, 1] is outside the fence")


def test_remaining_agents_keep_their_positions() -> None:
    changed = Changing(task(**MOVED), 8.0, "on_agents_removed", (0, 2))
    flown = fly(changed, ROOM, AIR, stuck=lambda time: np.array([False, time > 8, False]))
    assert flown.status is Status.SUCCESS
    assert flown.end[[0, 2]] == pytest.approx(moved().end[[0, 2]], abs=0.05)
    assert flown.goals[-1].active.tolist() == [True, False, True]


def test_a_replacement_takes_the_position() -> None:
    whole = fly(task(crew=(0, 1), **MOVED), ROOM, AIR)
    changed = Changing(task(crew=(0, 1), **MOVED), 3.0, "on_agent_replaced", 1, 2)
    flown = fly(changed, ROOM, AIR)
    assert flown.status is Status.SUCCESS
    assert flown.end[2] == pytest.approx(whole.end[1], abs=0.1)


def test_goals_have_a_velocity_only_while_the_formation_moves() -> None:
    at: dict[str, Any] = {"shape": "line", "centre": AIR[1], "spacing": 1.0}
    moving = task(**at, move={"to": [1.0, 0.0, 0.8], "speed": 0.2}, **ONE_SECOND)
    moving.begin(estimate(np.array(AIR)), health(3, AgentPhase.FLYING))
    held = moving.step(estimate(np.array(AIR)), health(3)).goals
    moved = moving.step(estimate(np.array(AIR), time=1.0), health(3)).goals
    assert held is not None
    assert not held.velocity.any()
    assert moved is not None
    assert moved.velocity.tolist() == [[0.2, 0.0, 0.0]] * 3


def test_no_agent_is_asked_to_fly_faster_than_the_limit() -> None:
    room = replace(ROOM, limits=replace(ROOM.limits, speed=0.2))
    flown = fly(task(room, speed=9.0, **MOVED), room, AIR)
    assert max(goals.speed.max() for goals in flown.goals) <= 0.2
