"""The flight to a point that planners share; its law is tested through the planner ``straight``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from star_core import Array
from star_core.messages.state import Goals
from star_core.testing import estimate, scene
from star_core.toolkit.position_control import PositionController

LOW = np.array([[2.0, 0.0, 0.7]])  # m: 0.3 below the middle of a line at 1 m


def goal(x: float, z: float, *, moves: float = 0.0) -> Goals:
    """The goal of one agent above the x axis, which may move along it."""
    velocity = np.array([[moves, 0, 0]])
    return Goals(
        np.array([[x, 0, z]]), velocity, np.zeros(1), np.full(1, 0.5), np.ones(1, np.bool_)
    )


def velocities(goals: Goals, *positions: Array) -> Array:
    """The velocity of one agent at each of some positions, one after the other."""
    control = PositionController(scene(1), gain=1.0, yaw_rate_deg=90.0)
    return np.array([control.velocity(estimate(position), goals)[0] for position in positions])


def test_agents_below_their_line_climb_back_to_it() -> None:
    begin, low = np.array([[0.0, 0, 1]]), LOW
    level, back = velocities(goal(4.0, 1.0), begin, low)
    assert level == pytest.approx([0.5, 0, 0])
    assert back[2] / back[0] == pytest.approx(0.3 / 0.5)  # gain times error, over the speed
    assert np.linalg.norm(back) == pytest.approx(0.5)


def test_a_new_goal_begins_a_new_line() -> None:
    control = PositionController(scene(1), gain=1.0, yaw_rate_deg=90.0)
    control.velocity(estimate(np.array([[0.0, 0, 1]])), goal(4.0, 1.0))
    velocity = control.velocity(estimate(LOW), goal(5.0, 0.7))
    assert velocity[0] == pytest.approx([0.5, 0, 0])


@pytest.mark.parametrize("gone", ["active", "valid"])
def test_interrupted_goals_begin_a_new_line(gone: str) -> None:
    control = PositionController(scene(1), gain=1.0, yaw_rate_deg=90.0)
    goals, now = goal(4.0, 1.0), estimate(np.array([[0.0, 0, 1]]))
    control.velocity(now, goals)
    no = np.zeros(1, np.bool_)
    if gone == "active":
        control.velocity(estimate(LOW), replace(goals, active=no))
    else:
        control.velocity(replace(estimate(LOW), valid=no), goals)
    assert control.velocity(estimate(LOW), goals)[0, 2] < 0.1


def test_an_agent_beside_a_steep_line_climbs_along_it() -> None:
    begin, aside = np.array([[0.0, 0, 0.5]]), np.array([[0.1, 0, 1.0]])
    _, velocity = velocities(goal(0.0, 1.5), begin, aside)
    assert velocity == pytest.approx(0.5 * np.array([-0.1, 0, 0.5]) / np.hypot(0.1, 0.5))


def test_a_moving_goal_has_no_line() -> None:
    control = PositionController(scene(1), gain=1.0, yaw_rate_deg=90.0)
    control.velocity(estimate(np.array([[0.0, 0, 1]])), goal(4.0, 1.0, moves=0.1))
    moved = goal(4.01, 1.0, moves=0.1)
    velocity = control.velocity(estimate(LOW), moved)
    np.testing.assert_array_equal(velocity, velocities(moved, LOW))


def test_agents_do_not_brake_for_intermediate_points() -> None:
    homing = PositionController(scene(2), gain=1.0, yaw_rate_deg=90.0)
    near = Goals(
        position=np.array([[0.1, 0, 1], [0.1, 0, 1]]),
        velocity=np.zeros((2, 3)),
        yaw=np.zeros(2),
        speed=np.full(2, 0.5),
        active=np.ones(2, np.bool_),
    )
    now = estimate(np.array([[0.0, 0, 1], [0, 0, 1]]))
    velocity = homing.velocity(now, near, beyond=np.array([0.0, 2.0]))
    assert velocity[:, 0] == pytest.approx([0.1, 0.5])
