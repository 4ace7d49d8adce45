"""How the on-board estimators take in poses that are sent to them.

The firmware's Kalman filter keeps a covariance; the constant-gain filter of `star_sim.estimator`
does not. What its errors would be taken for grows here, at the rate at which it does there, and a
pose is weighed against that. Its roll, pitch and height are passed over: accelerometer and ranger
say more. A velocity in the body stays what it is, as there.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Array, Corrections
from star_sim.airframe import CYCLE
from star_sim.drone import Drones
from star_sim.estimator import FLOW_GAIN
from star_sim.position import wrap

ACCELERATION: Final = 0.5  # m/s², the firmware's process noise
RATE: Final = 0.1  # rad/s, what it takes a gyro's noise for

# A velocity that is drawn by a gain g to measurements settles at the variance q (1 - g) / g, with q
# what a step adds; its error lasts, so a position that integrates it gains 2 / g - 1 times that.
VELOCITY_VARIANCE: Final = (ACCELERATION * CYCLE) ** 2 * (1 - FLOW_GAIN) / FLOW_GAIN
POSITION_GROWTH: Final = CYCLE * VELOCITY_VARIANCE * (2 / FLOW_GAIN - 1)  # m²/s
YAW_GROWTH: Final = RATE**2 * CYCLE  # rad²/s


class Fusion:
    """The variances of all drones' estimates.

    Args:
        agents: How many there are.
    """

    def __init__(self, agents: int) -> None:
        self._time = np.zeros(agents)  # s, up to which the variances were carried
        self._position = np.zeros(agents)  # m², along x and along y
        self._yaw = np.zeros(agents)  # rad²

    def forget(self, row: int, now: float) -> None:
        """Begin anew with an estimate that was set, at `now`, s, to what is known."""
        self._time[row] = now
        self._position[row] = self._yaw[row] = 0.0

    def variance(self, now: float) -> tuple[Array, Array]:
        """Return the variances at `now`, s: (N,) m² along x and along y, and (N,) rad² of yaw."""
        passed = now - self._time
        return self._position + POSITION_GROWTH * passed, self._yaw + YAW_GROWTH * passed

    def take(self, drones: Drones, corrections: Corrections, now: float) -> None:
        """Draw what the drones believe at `now`, s, to the poses they are sent."""
        for row, position, attitude, position_deviation, yaw_deviation in zip(
            corrections.agent.tolist(),
            corrections.position,
            corrections.attitude,
            corrections.position_deviation.tolist(),
            corrections.attitude_deviation.tolist(),
            strict=True,
        ):
            passed = now - self._time[row]
            self._time[row] = now
            variance = self._position[row] + POSITION_GROWTH * passed
            gain = variance / (variance + position_deviation**2)
            self._position[row] = (1 - gain) * variance
            believed = drones["believed_position"][row]
            believed[:2] += gain * (position[:2] - believed[:2])

            variance = self._yaw[row] + YAW_GROWTH * passed
            gain = variance / (variance + yaw_deviation**2)
            self._yaw[row] = (1 - gain) * variance
            x, y, z, w = attitude.tolist()
            yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
            turn = gain * wrap(yaw - float(drones["believed_yaw"][row]))
            drones["believed_yaw"][row] = wrap(float(drones["believed_yaw"][row]) + turn)
            velocity = drones["believed_velocity"][row]
            ahead = complex(velocity[0], velocity[1]) * complex(math.cos(turn), math.sin(turn))
            velocity[:2] = ahead.real, ahead.imag
