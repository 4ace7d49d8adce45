"""Agents whose flow sensor measures less motion than there is, by the drag of the air."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Telemetry
from star_core.toolkit import quaternion_from_euler
from star_monitors.drag_check import DRAG, DragCheck

PERIOD = 0.05  # s
BEGUN = 6.0  # s, when something goes wrong
RADIUS = 1.2  # m, of the circle that the agent flies
AIRBORNE = np.ones(1, np.bool_)


def detection_time(
    speed: float,
    *,
    scale: float = 1.0,
    bias: float = 0.15,
    gusts: float = 0.0,
    turns: float = 0.0,
    seed: int = 0,
) -> float:
    """Return when an agent is found that flies along a circle; infinity if never within 40 s.

    Args:
        speed: True speed, m/s.
        scale: What its flow sensor measures of it from `BEGUN` on.
        bias: Constant error of the accelerometer, m/s².
        gusts: Standard deviation of the wind, m/s, with a correlation time of 1 s.
        turns: Yaw rate, rad/s.
        seed: Of the noise: that of recorded flights, 0.02 m/s² with a correlation time of 0.6 s.
    """
    check, random = DragCheck(1), np.random.default_rng(seed)
    noise = wind = 0.0 + 0.0j
    for k in range(800):
        time = k * PERIOD
        white = complex(*random.standard_normal(2)), complex(*random.standard_normal(2))
        noise += PERIOD / 0.6 * -noise + 0.02 * np.sqrt(2 * PERIOD / 0.6) * white[0]
        wind += PERIOD * -wind + gusts * np.sqrt(2 * PERIOD) * white[1]
        velocity = speed * np.exp(1j * speed / RADIUS * time) * (time >= 2.0)
        reported = velocity * (scale if time >= BEGUN else 1.0)
        heading = np.exp(1j * turns * time)
        force = -DRAG * (velocity - wind) / heading + bias + noise
        telemetry = Telemetry(
            time,
            np.array([[0.0, 0.0, 1.0]]),
            np.array([[reported.real, reported.imag, 0.0]]),
            quaternion_from_euler(np.zeros(1), np.zeros(1), np.array([turns * time])),
            np.zeros(1),
            np.zeros(1, np.int64),
            np.zeros(1),
            specific_force=np.array([[force.real, force.imag]]),
        )
        if check.check(telemetry, AIRBORNE)[0]:
            return time
    return np.inf


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("speed", "limit"), [(0.55, 10.0), (1.0, 3.0)])
def test_a_flow_sensor_that_misses_motion_is_found(seed: int, speed: float, limit: float) -> None:
    assert BEGUN < detection_time(speed, scale=0.7, seed=seed) <= BEGUN + limit
    assert BEGUN < detection_time(speed, scale=0.7, turns=-0.2, seed=seed) <= BEGUN + 2 * limit


@pytest.mark.parametrize(
    "flight", [{}, {"scale": 0.9}, {"scale": 1.3}, {"bias": -0.3, "turns": -0.2}, {"gusts": 0.3}]
)
@pytest.mark.parametrize("seed", range(2))
def test_other_flights_are_let_alone(flight: dict[str, float], seed: int) -> None:
    assert detection_time(0.5, **flight, seed=seed) == np.inf


def test_wandering_accelerometers_are_no_wrong_flow_sensors() -> None:
    n, legs, period = 300, 5, 0.1  # s between two reports; legs of 16 s at 0.25 m/s, to and fro
    check, random = DragCheck(n), np.random.default_rng(0)
    wander, level = 0.03 * random.standard_normal((n, 2)), np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    share, zero = 0.07 * random.standard_normal((n, 1)), np.zeros(n)  # that flow sensors miss
    for k in range(round(16 * legs / period)):
        time = k * period
        wander += period / 10 * -wander + random.normal(0, 0.03 * (2 * period / 10) ** 0.5, (n, 2))
        noise = random.normal(0, (0.0003 / period) ** 0.5, (n, 2))
        speed = 0.25 * (-1) ** (time // 16) * (time >= 2.0)
        velocity = np.tile([speed, 0.0, 0.0], (n, 1))
        force = -DRAG * (1 + share) * velocity[:, :2] + wander + noise
        now = Telemetry(
            time, velocity, velocity, level, zero, zero.astype(np.int64), zero, specific_force=force
        )
        assert not check.check(now, np.ones(n, np.bool_)).any()


def test_an_agent_without_an_accelerometer_is_not_judged() -> None:
    check, zero = DragCheck(1), np.zeros(1)
    level = np.array([[0.0, 0.0, 0.0, 1.0]])
    fast = np.array([[3.0, 0.0, 0.0]])
    for k in range(200):
        now = Telemetry(0.05 * k, fast, fast, level, zero, np.zeros(1, np.int64), zero)
        assert not check.check(now, AIRBORNE).any()
