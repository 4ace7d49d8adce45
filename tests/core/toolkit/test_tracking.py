"""What makes drones follow trajectories although their controllers lag."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from star_core import Array, Goals, Setpoint
from star_core.testing import estimate
from star_core.toolkit import FullStates, VelocityLead
from star_core.toolkit.tracking import MAX_BIAS, TILT_LAG, TRACKING_GAIN, VELOCITY_GAIN, Tracking

PERIOD, STEP = 0.05, 0.002  # s
RATE = 1.7  # rad/s, of a reference that swings by 0.5 m: up to 0.85 m/s and 1.4 m/s²


def reference(time: float) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration along x."""
    phase = RATE * time
    values = 0.5 * math.sin(phase), 0.5 * RATE * math.cos(phase), -0.5 * RATE**2 * math.sin(phase)
    point, velocity, acceleration = (np.array([[value, 0.0, 0.0]]) for value in values)
    return point, velocity, acceleration


def setpoint(
    velocity: Array, point: Array | None = None, acceleration: Array | None = None
) -> Setpoint:
    return Setpoint(velocity, np.zeros(1), np.ones(1, np.bool_), point, acceleration)


def worst_velocity_error(*, leads: bool, integral: float = 0.0) -> float:
    """Greatest error of the velocity of a drone with the control that a lead is for, m/s."""
    lead = VelocityLead(1, PERIOD, gain=VELOCITY_GAIN, integral=max(integral, 0.01), delay=0.0)
    speed = reference(0.0)[1][0, 0]
    tilt = summed = worst = sent = 0.0
    for i in range(int(12 / STEP)):
        point, velocity, acceleration = reference(i * STEP)
        if i % round(PERIOD / STEP) == 0:
            desired = setpoint(velocity, point, acceleration if leads else None)
            sent = lead.velocity(desired)[0, 0]
        summed += STEP * (sent - speed)
        command = VELOCITY_GAIN * (sent - speed) + integral * summed
        tilt += STEP / TILT_LAG * (command - tilt)
        speed += STEP * tilt
        if i * STEP > 6:
            worst = max(worst, abs(speed - velocity[0, 0]))
    return worst


@pytest.mark.parametrize("integral", [0.0, 2.0])
def test_leads_make_up_for_lags_of_velocity_control(integral: float) -> None:
    assert worst_velocity_error(leads=False, integral=integral) > 0.2
    assert worst_velocity_error(leads=True, integral=integral) < 0.06


def test_velocities_without_a_trajectory_are_sent_unchanged() -> None:
    lead = VelocityLead(2, PERIOD)
    velocity = np.array([[0.3, 0, 0], [0.2, 0, 0]])
    unknown = np.full((2, 3), np.nan)
    partial = np.array([[1.0, 0, 0], [np.nan] * 3])
    both = np.ones(2, np.bool_)
    assert lead.velocity(Setpoint(velocity, np.zeros(2), both)) is not None
    sent = lead.velocity(Setpoint(velocity, np.zeros(2), both, unknown, unknown))
    assert sent.tolist() == velocity.tolist()
    sent = lead.velocity(Setpoint(velocity, np.zeros(2), both, partial, partial))
    assert sent[0, 0] > 0.3
    assert sent[1].tolist() == velocity[1].tolist()


@pytest.mark.parametrize("scale", [0.8, 1.2])
def test_agents_that_misjudge_their_velocity_are_led_back(scale: float) -> None:
    tracking, position = Tracking(1, PERIOD), reference(0.0)[0]
    flown = np.zeros((1, 3))
    errors = []
    for i in range(200):
        point, velocity, _ = reference(i * PERIOD)
        goals = Goals(point, velocity, np.zeros(1), np.ones(1), np.ones(1, np.bool_))
        now = replace(estimate(position), velocity=flown / scale)
        command = tracking.velocity(now, goals, np.ones(1, np.bool_))
        errors.append(float(np.linalg.norm(point - position)))
        flown = scale * command
        position = position + PERIOD * flown
    left = max(errors[50:])
    assert left < 0.8 * abs(1 / scale - 1) * 0.5 * RATE / TRACKING_GAIN


def test_full_states_begin_where_they_were_and_stay_near() -> None:
    states = FullStates(1, PERIOD)
    point, still = np.array([[1.0, 0, 0]]), np.zeros((1, 3))
    rows, begin = np.ones(1, np.bool_), np.array([[1.1, 0, 0.5]])
    position, velocity, acceleration = states.advance(setpoint(still, point, still), rows, begin)
    assert position[0] == pytest.approx([1.1, 0, MAX_BIAS])
    assert velocity == pytest.approx(still)
    assert acceleration == pytest.approx(still)
    back = setpoint(np.array([[-0.2, 0, 0]]), point, still)
    states.advance(back, rows, begin)
    states.advance(back, rows, begin)
    assert states.position[0, 0] == pytest.approx(1.1 - PERIOD * 0.2)


def test_full_states_are_ahead_of_the_lag() -> None:
    states, rows = FullStates(1, PERIOD), np.ones(1, np.bool_)
    for i in range(3):
        point, velocity, acceleration = reference(i * PERIOD)
        sent = states.advance(setpoint(velocity, point, acceleration), rows, point)
    ahead = reference(2 * PERIOD + 0.085)
    assert sent[0] == pytest.approx(ahead[0], abs=0.02)
    assert sent[1] == pytest.approx(ahead[1], abs=0.02)
    assert sent[2] == pytest.approx(reference(2 * PERIOD + TILT_LAG)[2], abs=0.1)
