"""Fusion of received positions and poses in the on-board estimators.

The firmware's Kalman filter (``kalman_core.c``) estimates velocities in the body frame and
integrates them along its heading, so its position and heading errors are correlated: a position fix
after some motion corrects the heading too. The constant-gain filter of `star_sim.estimator` keeps
no covariance, so this module keeps one of position and heading beside it, with the firmware's
process noise. Roll, pitch and height of a fix are ignored: accelerometer and ranger are more
accurate. A correction leaves velocities unchanged in the body frame.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Array, Corrections, Rows
from star_core.toolkit import wrap_angle, yaw_from_quaternion
from star_sim.airframe import CYCLE
from star_sim.drone import Drones
from star_sim.estimator import FLOW_GAIN

ACCELERATION: Final = 0.5  # m/s², the firmware's process noise
RATE: Final = 0.1  # rad/s, the firmware's gyro noise

# A velocity that is drawn by a gain g to measurements settles at the variance q (1 - g) / g, with q
# what a step adds; its error lasts, so a position that integrates it gains 2 / g - 1 times that.
VELOCITY_VARIANCE: Final = (ACCELERATION * CYCLE) ** 2 * (1 - FLOW_GAIN) / FLOW_GAIN
POSITION_GROWTH: Final = CYCLE * VELOCITY_VARIANCE * (2 / FLOW_GAIN - 1)  # m²/s
YAW_GROWTH: Final = RATE**2 * CYCLE  # rad²/s
HEIGHT_STD: Final = 0.0025  # m, noise of the ranger
START_STD: Final = 100.0  # m, the firmware's ``stdDevInitialPosition_xy``
START_YAW_STD: Final = 0.01  # rad, the firmware's ``stdDevInitialAttitude_yaw``
YAW: Final = 2  # column of the heading, after x and y


class Fusion:
    """The covariances of all drones' estimates of x, y and heading."""

    def __init__(self, agents: int) -> None:
        self._time = np.zeros(agents)  # s, of the last correction
        self._position = np.zeros((agents, 2))  # m, estimated after it
        self._covariance = np.zeros((agents, 3, 3))  # m and rad, after it

    def forget(self, drones: Drones, row: int, now: float) -> None:
        """Restart with an estimate that was set at `now`, s, to exactly known values."""
        self._time[row] = now
        self._position[row] = drones["believed_position"][row, :2]
        self._covariance[row] = 0.0

    def start_unknown(self, rows: Rows | int | slice = slice(None)) -> None:
        """Restart with positions that are not known, as the firmware's filter does."""
        self._covariance[rows] = np.diag([START_STD**2, START_STD**2, START_YAW_STD**2])

    def position_variance(self, drones: Drones, now: float) -> Array:
        """Return the variances of the positions at `now`, s: (N, 3) m²; heights are ranged."""
        planar = np.diagonal(self.covariance(drones, now), axis1=1, axis2=2)
        return np.column_stack([planar[:, :2], np.full(len(planar), HEIGHT_STD**2)])

    def velocity_variance(self, drones: Drones, _now: float) -> Array:
        """Return the variances of the velocities, (N, 3) m²/s²: those at which they settle."""
        return np.full((len(drones), 3), VELOCITY_VARIANCE)

    def covariance(self, drones: Drones, now: float) -> Array:
        """Return the (N, 3, 3) covariances of x, y (m) and heading (rad) at `now`, s.

        Between two corrections a heading error rotates the path flown since the first about its
        start. Heading noise on the way is modelled as for a straight path at constant speed.
        """
        passed = now - self._time
        way = drones["believed_position"][:, :2] - self._position
        lever = np.stack([-way[:, 1], way[:, 0]], axis=1)  # (N, 2) m of position per rad
        carry = np.tile(np.eye(3), (len(passed), 1, 1))
        carry[:, :YAW, YAW] = lever
        arising = np.zeros_like(carry)  # per rad² of heading noise
        arising[:, :YAW, :YAW] = lever[:, :, None] * lever[:, None, :] / 3
        arising[:, :YAW, YAW] = arising[:, YAW, :YAW] = lever / 2
        arising[:, YAW, YAW] = 1.0
        noise = YAW_GROWTH * arising + POSITION_GROWTH * np.diag([1.0, 1.0, 0.0])
        carried = carry @ self._covariance @ carry.transpose(0, 2, 1)
        return np.asarray(carried + passed[:, None, None] * noise)

    def take(self, drones: Drones, corrections: Corrections, now: float) -> None:
        """Correct the drones' estimates at `now`, s, with the positions and poses sent to them.

        One scalar measurement after the other, as the firmware does; an infinite standard deviation
        is no measurement.
        """
        rows = corrections.agent
        self._covariance[rows] = self.covariance(drones, now)[rows]
        self._time[rows] = now
        for row, position, attitude, position_std, yaw_std in zip(
            rows.tolist(),
            corrections.position,
            corrections.attitude,
            corrections.position_deviation.tolist(),
            corrections.attitude_deviation.tolist(),
            strict=True,
        ):
            yaw = float(yaw_from_quaternion(attitude))
            before = float(drones["believed_yaw"][row])
            estimate = np.array([*drones["believed_position"][row, :2], before])
            measured = np.array([*position[:2], before + wrap_angle(yaw - before)])
            covariance = self._covariance[row]
            for axis, std in enumerate((position_std, position_std, yaw_std)):
                if math.isfinite(std):
                    gain = covariance[axis] / (covariance[axis, axis] + std**2)
                    estimate += gain * (measured[axis] - estimate[axis])
                    covariance -= np.outer(gain, covariance[axis])
            self._position[row] = drones["believed_position"][row, :2] = estimate[:YAW]
            drones["believed_yaw"][row] = wrap_angle(float(estimate[YAW]))
            turn = estimate[YAW] - before
            velocity = drones["believed_velocity"][row]
            ahead = complex(velocity[0], velocity[1]) * complex(math.cos(turn), math.sin(turn))
            velocity[:2] = ahead.real, ahead.imag
