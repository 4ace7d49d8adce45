"""The verb ``goto``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from star_core import Estimate, Fence, Goals, Registry, Status, World, load
from star_core import fly as fly_mission
from star_core.testing import estimate, health, scene
from tests.plugins.mission_files import write_mission
from tests.plugins.tasks.conftest import fly, make

AIR = [[-0.5, 0.0, 0.8], [0.5, 0.0, 0.8], [1.5, 0.0, 0.8]]
HALL = World("hall", Fence((-3.0, -3.0, 0.0), (3.0, 3.0, 3.0)))


@pytest.mark.parametrize(("options", "yaw"), [({}, 0.0), ({"yaw_deg": -90}, -np.pi / 2)])
def test_one_agent_goes_to_the_point_and_stops(options: dict[str, float], yaw: float) -> None:
    room = scene(1)
    flown = fly(make("goto", room, (0,), to=[1.0, 2.0, 1.2], **options), room, AIR[:1])
    assert flown.status is Status.SUCCESS
    assert flown.end[0] == pytest.approx([1.0, 2.0, 1.2], abs=0.1)
    assert np.linalg.norm(flown.track[-1] - flown.track[-2]) < 0.15 * room.period
    assert flown.yaw[-1] == pytest.approx([yaw])


def test_several_agents_spread_around_the_point() -> None:
    room = scene(3)
    flown = fly(make("goto", room, (0, 1, 2), to=[0.0, 2.0, 0.8], within=0.02), room, AIR)
    apart = np.linalg.norm(flown.end[:, None] - flown.end[None], axis=2)
    assert flown.end.mean(axis=0) == pytest.approx([0.0, 2.0, 0.8], abs=0.02)
    assert apart[np.triu_indices(3, 1)] == pytest.approx([0.6] * 3, abs=0.04)


def test_each_agent_goes_by_the_offset_from_where_it_is() -> None:
    room = scene(3)
    flown = fly(make("goto", room, (0, 2), by=[0.0, 1.0, 0.2], within=0.02), room, AIR)
    assert flown.end[[0, 2]] == pytest.approx(
        np.array([[-0.5, 1.0, 1.0], [1.5, 1.0, 1.0]]), abs=0.02
    )
    assert flown.end[1].tolist() == AIR[1]


@pytest.mark.parametrize(
    ("goal", "active", "start"),
    [(0.8, 1, [0.0, 0.0, 0.8]), (0.8, 0, [0.1, 0.0, 0.65]), (1.2, 1, [0.1, 0.0, 0.65])],
    ids=["the agent sags", "without a goal", "the agent was on its way"],
)
def test_an_offset_counts_from_the_last_goal_nearby(
    goal: float, active: int, start: list[float]
) -> None:
    room = scene(1)
    place = np.array([[0.1, 0.0, 0.65]])
    last = Goals(
        np.array([[0.0, 0.0, goal]]), place * 0, place[:, 0], place[:, 0], np.array([active > 0])
    )
    task = make("goto", room, (0,), by=[1.0, 0.0, 0.1])
    task.continue_from(last)
    task.begin(estimate(place), health(1))
    assert task.goals.position[0] == pytest.approx(np.add(start, [1.0, 0.0, 0.1]))


def test_offsets_back_from_outside_the_fence_end_inside() -> None:
    room = replace(scene(1), world=HALL)
    outside = np.array([[0.0, 3.13, 0.8]])  # as far as it may have drifted in a landing
    last: Goals | None = None
    for by in ([0.0, -0.65, 0.0], [0.0, 0.65, 0.0]):
        task = make("goto", room, (0,), by=by)
        if last is not None:
            task.continue_from(last)
            outside = last.position
        task.begin(estimate(outside), health(1))
        assert task.step(estimate(outside), health(1)).status is not Status.FAILURE
        last = task.goals
    assert last is not None
    assert last.position[0] == pytest.approx([0.0, 2.99, 0.8])


@pytest.mark.parametrize(("speed", "expected"), [(None, 0.5), (0.2, 0.2), (2.0, 0.5)])
def test_no_agent_exceeds_the_speed_or_the_limit(speed: float | None, expected: float) -> None:
    room = scene(1)
    options = {} if speed is None else {"speed": speed}
    flown = fly(make("goto", room, (0,), to=[2.0, 0.0, 0.8], **options), room, AIR[:1])
    steps = np.linalg.norm(np.diff(flown.track[:, 0], axis=0), axis=1) / room.period
    assert steps.max() == pytest.approx(expected)


def test_a_row_that_is_not_located_has_not_arrived() -> None:
    room = scene(1)
    task = make("goto", room, (0,), to=[0.5, 0.0, 0.8])
    flown = fly(task, room, AIR[:1], located=lambda time: np.array([not 1.0 <= time < 20.0]))
    assert flown.status is Status.SUCCESS
    assert flown.time >= 20.0


def test_a_flight_may_take_three_times_its_way_and_5_s() -> None:
    room = scene(1)
    task = make("goto", room, (0,), by=[1.0, 0.0, 0.0], speed=0.25)
    assert fly(task, room, AIR[:1], longest=0.0).limit == pytest.approx(3 * 4.0 + 5)


def test_timeouts_from_unknown_positions_assume_the_whole_fence() -> None:
    room = scene(1)
    task = make("goto", room, (0,), to=[1.0, 0.0, 0.8])
    flown = fly(task, room, AIR[:1], located=lambda _: np.array([False]), longest=0.0)
    assert flown.limit == pytest.approx(3 * np.sqrt(20**2 + 20**2 + 3**2) / 0.5 + 5)


def test_an_offset_out_of_the_fence_fails_and_names_the_agents() -> None:
    room = replace(scene(2), world=HALL)
    flown = fly(make("goto", room, (0, 1), by=[2.7, 0.0, 0.0]), room, AIR[:2])
    assert flown.status is Status.FAILURE
    assert flown.reason == (
        "cf2 cannot be there: [3.2, 0, 0.8] is outside the fence, from [-3, -3, 0] to [3, 3, 3]"
    )


HOP = """\
  - takeoff: {height: 0.8, speed: 0.5}
  - parallel:
      - goto: {agents: cf1, to: [0, 0.1, 0.8]}
      - goto: {agents: cf2, to: [0.5, 0, 0.8], speed: 0.08}
"""


def test_a_short_flight_waits_until_a_slow_agent_has_passed(tmp_path: Path) -> None:
    registry = Registry()
    path = write_mission(
        tmp_path,
        HOP,
        swarm="{cf1: {start: [0, 0.5, 0]}, cf2: {start: [-0.35, 0, 0]}}",
        transport="{use: sim, noise: false}",
        avoider="orca",
    )
    summary = fly_mission(load(path, registry), registry)
    assert summary["outcome"] == "completed", summary["reason"]
    begun, ended = (summary["steps"][1][key] for key in ("begun_s", "ended_s"))
    assert ended - begun > 7.4  # three times 0.8 s, and 5 s: its timeout if it were alone


def at(x: float, *, speed: float = 0.0, other: float = 1.5) -> Estimate:
    """Return an estimate of two agents beside each other, the first one at `x`, m."""
    still = estimate(np.array([[x, 0.0, 0.8], [other, 0.0, 0.8]]))
    return replace(still, velocity=np.array([[speed, 0.0, 0.0], [0.0, 0.0, 0.0]]))


@pytest.mark.parametrize(
    ("steps", "arrived"),
    [
        ([at(0.95), at(1.15, other=2.45), at(1.05, speed=0.3, other=2.45)], 1),
        ([at(0.95), at(1.25, other=2.45), at(1.15, other=2.45), at(1.05, other=2.45)], 3),
    ],
    ids=["not at the same tick", "anew after they were pushed far away"],
)
def test_agents_that_make_way_arrive(steps: list[Estimate], arrived: int) -> None:
    task = make("goto", scene(2), (0, 1), by=[1.0, 0.0, 0.0])
    task.begin(at(0.0), health(2))
    statuses = [task.step(now, health(2)).status for now in steps]
    assert statuses == [Status.RUNNING] * arrived + [Status.SUCCESS] * (len(steps) - arrived)


def test_timeouts_of_large_swarms_allow_for_several_crossings() -> None:
    limits = [
        make("goto", scene(n), (0,), by=[0.0, 0.0, 0.1]).begin(
            estimate(np.array([[float(i), 0.0, 0.8] for i in range(n)])), health(n)
        )
        for n in (2, 4, 16)
    ]
    assert limits[0] == limits[1]
    assert limits[2] - 5.0 == pytest.approx(2 * (limits[1] - 5.0), rel=0.1)


def test_agents_go_beside_another_agent_at_the_start_of_the_step() -> None:
    room = scene(2)
    task = make("goto", room, (0,), relative_to="cf2", by=[0.0, 1.0, 0.2], within=0.02)
    flown = fly(task, room, AIR[:2])
    assert flown.status is Status.SUCCESS
    assert flown.end[0] == pytest.approx([0.5, 1.0, 1.0], abs=0.02)


def test_several_agents_spread_around_a_point_beside_another() -> None:
    room = scene(3)
    task = make("hold", room, (0, 1), relative_to="cf3", by=[0.0, 1.0, 0.0], spacing=0.8)
    flown = fly(task, room, AIR)
    assert flown.end[:2].mean(axis=0) == pytest.approx([1.5, 1.0, 0.8], abs=0.1)


def test_a_goal_beside_an_agent_waits_until_that_is_located() -> None:
    room = scene(2)
    task = make("goto", room, (0,), relative_to="cf2", by=[0.0, 1.0, 0.2])
    line = np.array(AIR[:2])
    unlocated = replace(estimate(line), valid=np.array([True, False]))
    task.begin(unlocated, health(2))
    assert task.step(unlocated, health(2)).goals is None
    goals = task.step(estimate(line), health(2)).goals
    assert goals.position[0].tolist() == [0.5, 1.0, 1.0]


def test_a_moving_goal_stays_where_agents_can_be() -> None:
    room = replace(scene(2), world=World("hall", Fence((-3.0, -3.0, 0.0), (3.0, 3.0, 3.0))))
    task = make("hold", room, (0,), relative_to="cf2", by=[0.0, 1.0, 0.0], moving=True)
    passed: list[float] = []
    for y in (0.0, 1.5, 2.5, 1.0):
        now = estimate(np.array([[0.0, 0, 1], [1.0, y, 1]]))
        if not passed:
            task.begin(now, health(2))
        passed.append(task.step(now, health(2)).goals.position[0, 1])
    assert passed == [1.0, 2.5, 2.5, 2.0]


ESCORT = """\
  - takeoff: {height: 0.8}
  - parallel:
      - follow: {agents: cf1, path: circle, size: 2, centre: [0, 0, 0.8], speed: 0.3}
      - hold: {agents: cf2, relative_to: cf1, by: [0, 1, 0], moving: true, for: 15}
"""


def test_an_agent_escorts_another_that_flies_a_circle(tmp_path: Path) -> None:
    registry = Registry()
    path = write_mission(
        tmp_path,
        ESCORT,
        swarm="{cf1: {start: [1, 0, 0]}, cf2: {start: [1, 1, 0]}}",
        transport="{use: sim, profile: ideal, controller: ideal, noise: false}",
        avoider="orca",
    )
    mission = load(path, registry)
    rehearsal = registry.manager.hook.star_rehearse(mission=mission, registry=registry)
    (hold,) = (step for step in rehearsal.steps if step.action.verb == "hold")
    beside = np.diff(rehearsal.position[rehearsal.during(hold)], axis=1)[:, 0]
    assert np.linalg.norm(beside - [0.0, 1.0, 0.0], axis=1).max() < 0.15
    assert hold.duration == pytest.approx(15.0, abs=0.5)
