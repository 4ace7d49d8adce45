"""The planner ``straight``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from star_core import Array, Goals, Limits
from star_core.testing import estimate, scene
from tests.plugins.planners.inputs import goals, straight
from tests.sampling import share_of_examples

N = 3
tables = arrays(np.float64, (N, 3), elements=st.floats(-9, 9))
speeds = arrays(np.float64, N, elements=st.floats(0, 2))


@given(tables, tables, tables, speeds)
def test_no_speed_is_above_the_goals_or_the_limit(
    start: Array, goal: Array, velocity: Array, speed: Array
) -> None:
    plan = straight(scene(N)).plan(estimate(start), goals(goal, speed=speed, velocity=velocity))
    flown = np.linalg.norm(plan.setpoint.velocity, axis=1)
    assert (flown <= np.minimum(speed, 0.5) + 1e-9).all()


@given(tables, tables, tables, speeds)
def test_vertical_speed_stays_within_the_heights_for_a_tick(
    start: Array, goal: Array, velocity: Array, speed: Array
) -> None:
    start = start.copy()
    start[:, 2] = np.clip(start[:, 2], 0.2, 1.8)
    room = scene(N)
    plan = straight(room).plan(estimate(start), goals(goal, speed=speed, velocity=velocity))
    height = start[:, 2] + room.period * plan.setpoint.velocity[:, 2]
    assert ((height >= 0.2 - 1e-9) & (height <= 1.8 + 1e-9)).all()


@pytest.mark.parametrize(("height", "sign"), [(0.1, 1), (2.5, -1)])
def test_an_agent_outside_the_heights_is_led_back(height: float, sign: int) -> None:
    plan = straight(scene(1)).plan(estimate(np.array([[0, 0, height]])), goals([[0, 0, height]]))
    assert np.sign(plan.setpoint.velocity[0, 2]) == sign


def test_far_from_the_goal_it_flies_straight_at_the_goals_speed() -> None:
    plan = straight(scene(1)).plan(
        estimate(np.array([[0, 0, 1.0]])), goals([[3, 4, 1.0]], speed=0.4)
    )
    assert plan.setpoint.velocity[0] == pytest.approx([0.24, 0.32, 0.0])


def test_near_the_goal_its_speed_falls_with_the_distance() -> None:
    near = straight(scene(1), gain=2.0)
    plan = near.plan(estimate(np.array([[0, 0, 1.0]])), goals([[0.1, 0, 1.0]]))
    assert plan.setpoint.velocity[0] == pytest.approx([0.2, 0.0, 0.0])


def test_it_brakes_with_half_the_greatest_acceleration() -> None:
    room = scene(1, limits=Limits(speed=5.0, acceleration=2.0))
    plan = straight(room, gain=100.0).plan(
        estimate(np.array([[0, 0, 1.0]])), goals([[2, 0, 1.0]], speed=5.0)
    )
    assert plan.setpoint.velocity[0] == pytest.approx([2.0, 0.0, 0.0])  # sqrt(2 * 1 * 2)


def test_at_the_goal_it_flies_with_the_goal() -> None:
    moving = goals([[1, 1, 1.0]], velocity=np.array([[0.1, -0.2, 0.0]]))
    plan = straight(scene(1)).plan(estimate(np.array([[1, 1, 1.0]])), moving)
    assert plan.setpoint.velocity[0] == pytest.approx([0.1, -0.2, 0.0])


@share_of_examples(0.4)
@given(tables, tables, st.floats(0.5, 3.0))
def test_a_goal_that_stands_is_reached(start: Array, goal: Array, gain: float) -> None:
    room = scene(N)
    start, goal = (room_of * [0.3, 0.3, 0.08] + [0, 0, 1] for room_of in (start, goal))
    leads, position = straight(room, gain=gain), start
    for _ in range(round((20 + 6 / gain) / room.period)):  # 7.8 m at most, at 0.5 m/s
        flown = leads.plan(estimate(position), goals(goal, speed=0.5)).setpoint
        position = position + room.period * flown.velocity
    assert position == pytest.approx(goal, abs=0.01)


def test_rows_without_a_goal_or_an_estimate_are_idle() -> None:
    position = np.array([[0, 0, 1.0], [1, 0, 1], [np.nan] * 3])
    now = replace(estimate(position), valid=np.array([True, True, False]))
    targets = goals(np.ones((3, 3)), active=np.array([False, True, True]))
    plan = straight(scene(3)).plan(now, targets)
    assert plan.setpoint.active.tolist() == [False, True, False]
    assert plan.setpoint.velocity[[0, 2]].tolist() == [[0.0] * 3] * 2
    assert np.isfinite(plan.setpoint.yaw).all()


def test_each_path_is_from_the_agent_to_its_goal() -> None:
    position = np.array([[0, 0, 1.0], [1, 0, 1], [2, 0, 1]])
    targets = goals(position + np.array([0, 2, 0]), active=np.array([True, False, True]))
    plan = straight(scene(3)).plan(estimate(position), targets)
    assert plan.paths.agent.tolist() == [0, 0, 2, 2]
    assert plan.paths.point.tolist() == [[0, 0, 1], [0, 2, 1], [2, 0, 1], [2, 2, 1]]


def test_nothing_is_unreachable() -> None:
    plan = straight(scene(3)).plan(estimate(np.zeros((3, 3))), goals(np.full((3, 3), 99.0)))
    assert plan.unreachable.tolist() == [False] * 3


def turn(yaw: float, goal: float, ticks: int) -> list[float]:
    """Headings asked of an agent that looks along `yaw` and does not turn, degrees."""
    leads = straight(scene(1), yaw_rate_deg=60.0)
    now = replace(estimate(np.array([[0, 0, 1.0]])), yaw=np.radians([yaw]))
    target = goals([[0, 0, 1.0]], yaw=np.radians([goal]))
    return [np.degrees(leads.plan(now, target).setpoint.yaw[0]) for _ in range(ticks)]


def test_the_heading_turns_no_faster_than_the_rate() -> None:
    assert turn(10, 90, ticks=3) == pytest.approx([13, 16, 19])


def test_the_heading_turns_the_shorter_way_round() -> None:
    assert turn(178, -170, ticks=3) == pytest.approx([-179, -176, -173])


def test_the_heading_stops_at_the_goals() -> None:
    assert turn(0, -5, ticks=4)[1:] == pytest.approx([-5, -5, -5])


def test_heading_resumes_from_the_measured_yaw_after_a_pause() -> None:
    leads = straight(scene(1), yaw_rate_deg=60.0)
    target = goals([[0, 0, 1.0]], yaw=np.radians([90]))
    first = estimate(np.array([[0, 0, 1.0]]))
    leads.plan(first, target)
    leads.plan(first, Goals.none(1))
    plan = leads.plan(replace(first, yaw=np.radians([45])), target)
    assert np.degrees(plan.setpoint.yaw) == pytest.approx([48])
