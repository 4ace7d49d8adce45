"""Agents that setpoints press against the geofence."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from star_core import Array, Estimate, Setpoint
from star_core.testing import estimate, scene
from star_monitors.setpoint_monitor import MAX_DRAW_IN, SIGMAS, FencePress

SPEED, TICK, HIGH = 0.5, 0.05, float(scene(1).world.fence.high[0])  # m/s, s, m
ALONG = np.array([[1.0, 0.0, 0.0]])


def setpoint(speed: float) -> Setpoint:
    """A setpoint along x, m/s."""
    return Setpoint(speed * ALONG, np.zeros(1), np.ones(1, np.bool_))


def believed(here: Array, velocity: Array, std: float) -> Estimate:
    """An agent at a position with this standard deviation along every axis, m."""
    covariance = std**2 * np.eye(3)[None]
    return replace(estimate(here), velocity=velocity, covariance=covariance)


def pressed(std: float, *, avoider: float = SPEED) -> tuple[FencePress, Array]:
    """Press an agent against the fence, which stops it there; return its position, m.

    The avoider may command less than the planner, which commands `SPEED`.
    """
    press, here, velocity = FencePress(scene(1)), np.array([[HIGH - 1, 0.0, 1.0]]), np.zeros((1, 3))
    for _ in range(400):
        now = believed(here, velocity, std)
        room = max(0.0, 2.5 * (HIGH - here[0, 0] - 0.4 * velocity[0, 0]))  # by the safety filter
        answer = press.draw_in(now, setpoint(min(avoider, room)), setpoint(SPEED))[0].velocity
        velocity = velocity + (1 - math.exp(-TICK / 0.35)) * (np.minimum(answer, room) - velocity)
        here = here + TICK * velocity
    return press, here


@pytest.mark.parametrize("avoider", [SPEED, 0.1])
def test_pressing_against_the_fence_draws_in_by_uncertainty(avoider: float) -> None:
    assert pressed(0.1, avoider=avoider)[1][0, 0] == pytest.approx(HIGH - SIGMAS * 0.1, abs=0.01)
    assert pressed(0.0)[1][0, 0] == pytest.approx(HIGH, abs=0.01)
    assert pressed(99.0)[1][0, 0] >= HIGH - MAX_DRAW_IN - 0.01


def test_drawn_in_agents_still_reach_goals_near_the_fence() -> None:
    press, here = pressed(0.1)
    now = believed(here, np.zeros((1, 3)), 0.1)
    assert press.draw_in(now, setpoint(0.3), setpoint(0.3))[0].velocity[0, 0] < 0.05
    assert press.draw_in(now, setpoint(-0.3), setpoint(-0.3))[0].velocity[0, 0] == -0.3
    for _ in range(40):
        assert press.draw_in(now, setpoint(0.3), setpoint(0.3))[0].velocity[0, 0] == 0.3


def test_velocities_that_cannot_brake_at_the_fence_lead_outside() -> None:
    def outward(x: float, avoider: float, planner: float) -> list[bool]:
        now = believed(np.array([[x, 0.0, 1.0]]), np.zeros((1, 3)), 0.1)
        outward: list[list[bool]] = (
            FencePress(scene(1)).draw_in(now, setpoint(avoider), setpoint(planner))[1].tolist()
        )
        return [row[0] for row in outward]

    assert outward(HIGH, 0.0, SPEED) == [False, True]
    assert outward(HIGH, SPEED, 0.0) == [True, False]
    assert outward(HIGH, -SPEED, -SPEED) == [False, False]
    assert outward(HIGH - 2.0, SPEED, SPEED) == [False, False]
