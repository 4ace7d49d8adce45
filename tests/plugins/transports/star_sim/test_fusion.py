"""The gains and the covariance of the on-board estimator are those of the firmware's filter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from star_core import Array
from star_sim import drone, estimator
from star_sim.airframe import CYCLE, GRAVITY
from star_sim.fusion import Fusion

FLOW_STD = 0.33  # m/s, 2 counts at 0.8 m
VELOCITY_NOISE = (0.5 * CYCLE) ** 2  # m²/s², per cycle
TILT_NOISE = (0.1 * CYCLE) ** 2  # rad², per cycle
RANGER_STD = 0.0025  # m
CLIMB_NOISE = (1.0 * CYCLE) ** 2  # m²/s², per cycle


def settled(
    carry: Array,
    noise: Array,
    deviation: float,
    measured: Callable[[int], bool] = lambda _cycle: True,
) -> Array:
    """Return the mean gain at which a Kalman filter settles that measures state 0 at times."""
    covariance, gains = np.zeros_like(noise), []
    for cycle in range(2000):
        covariance = carry @ covariance @ carry.T + noise
        if measured(cycle):
            gains.append(covariance[:, 0] / (covariance[0, 0] + deviation**2))
            covariance -= np.outer(gains[-1], covariance[0])
    mean: Array = np.mean(gains[-100:], axis=0)
    return mean


def test_constant_gains_equal_settled_kalman_gains() -> None:
    [velocity] = settled(np.eye(1), np.diag([VELOCITY_NOISE]), FLOW_STD)
    assert pytest.approx(velocity, rel=0.02) == estimator.FLOW_GAIN
    carry = np.array([[1.0, CYCLE * GRAVITY], [0.0, 1.0]])
    gains = settled(carry, np.diag([VELOCITY_NOISE, TILT_NOISE]), FLOW_STD)
    assert gains == pytest.approx([estimator.IMU_FLOW_GAIN, estimator.TILT_GAIN], rel=0.02)


def test_constant_height_gains_equal_settled_kalman_gains() -> None:
    carry = np.array([[1.0, CYCLE], [0.0, 1.0]])
    gains = settled(carry, np.diag([0.0, CLIMB_NOISE]), RANGER_STD, lambda n: 2 * n % 5 < 2)
    assert gains == pytest.approx([estimator.IMU_HEIGHT_GAIN, estimator.IMU_CLIMB_GAIN], rel=0.02)


def test_covariance_grows_as_that_of_integrated_velocity() -> None:
    gain = estimator.FLOW_GAIN
    carry = np.array([[1 - gain, 0.0], [CYCLE * (1 - gain), 1.0]])  # velocity, position
    measured = gain * np.array([1.0, CYCLE])
    covariance, variance = np.zeros((2, 2)), []
    for _ in range(2000):
        covariance = carry @ (covariance + np.diag([VELOCITY_NOISE, 0.0])) @ carry.T
        covariance += FLOW_STD**2 * np.outer(measured, measured)
        variance.append(covariance[1, 1])
    drones = np.zeros(1, drone.DRONE)
    fusion = Fusion(1)
    fusion.forget(drones, 0, 5.0)
    before, after = (fusion.covariance(drones, time)[0, 0, 0] for time in (15.0, 25.0))
    assert before > 0
    assert after - before == pytest.approx(variance[-1] - variance[-1001], rel=0.02)
