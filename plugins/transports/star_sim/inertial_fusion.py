"""Fusion of ranges, positions and headings in on-board estimators of drones without a Flow deck.

The firmware's Kalman filter (``kalman_core.c``) with its process noise. Between two measurements
`star_sim.estimator` integrates accelerometer and gyro, so the errors of position, velocity and tilt
grow together; a measurement corrects all of them by their covariance. A range is a measurement of
its own, as in the firmware: where anchors stand decides which directions it corrects.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Corrections, Rows
from star_core.toolkit import wrap_angle, yaw_from_quaternion
from star_sim.airframe import CYCLE, GRAVITY
from star_sim.drone import OFF, Drones
from star_sim.fusion import ACCELERATION, RATE, START_STD, START_YAW_STD, YAW_GROWTH

VERTICAL_ACCELERATION: Final = 1.0  # m/s², the firmware's process noise along z
START_HEIGHT_STD: Final = 1.0  # m, the firmware's ``stdDevInitialPosition_z``
START_VELOCITY_STD: Final = 0.01  # m/s, the firmware's ``stdDevInitialVelocity``
START_TILT_STD: Final = 0.01  # rad, the firmware's ``stdDevInitialAttitude_rollpitch``
CLOSEST: Final = 0.1  # m from an anchor: nearer, the direction of a range is not defined

# Errors in the frame of the estimate: x, y and z of the position, m, of the velocity, m/s, and of
# the acceleration by a wrong tilt, m/s² (none along z), and the heading, rad.
POSITION, VELOCITY, ACCELERATED, YAW = slice(0, 3), slice(3, 6), slice(6, 8), 9
SIZE: Final = 10

VELOCITY_GROWTH: Final = CYCLE * np.array([ACCELERATION, ACCELERATION, VERTICAL_ACCELERATION]) ** 2
TILT_GROWTH: Final = CYCLE * np.array([RATE * GRAVITY, RATE * GRAVITY, 0.0]) ** 2


class Ranges(NamedTuple):
    """Distances from some drones to anchors.

    Attributes:
        agent: (M,) rows of the drones.
        anchors: (K, 3) positions, m.
        distance: (M, K) m; NaN where an anchor is not received.
        std: Standard deviation that the estimators assume, m.
    """

    agent: Rows
    anchors: Array
    distance: Array
    std: float


class InertialFusion:
    """The covariances of all drones' estimates of position, velocity, tilt and heading."""

    def __init__(self, agents: int) -> None:
        self._time = np.zeros(agents)  # s, of the last measurement
        self._position = np.zeros((agents, 3))  # m, estimated after it
        self._velocity = np.zeros((agents, 3))  # m/s
        self._covariance = np.zeros((agents, SIZE, SIZE))  # after it

    def forget(self, drones: Drones, row: int, now: float) -> None:
        """Restart with an estimate that was set at `now`, s, to exactly known values."""
        self._note(drones, row, now)
        self._covariance[row] = 0.0

    def start_unknown(self, rows: Rows | int | slice = slice(None)) -> None:
        """Restart at rest and level, at positions that are not known, as the firmware does."""
        tilt, velocity = START_TILT_STD * GRAVITY, START_VELOCITY_STD
        start = [START_STD, START_STD, START_HEIGHT_STD, *[velocity] * 3, tilt, tilt, 0.0]
        self._covariance[rows] = np.diag(np.square([*start, START_YAW_STD]))

    def position_variance(self, drones: Drones, now: float) -> Array:
        """Return the variances of the positions at `now`, s: (N, 3) m²."""
        return np.diagonal(self._carried(drones, now), axis1=1, axis2=2)[:, POSITION].copy()

    def velocity_variance(self, drones: Drones, now: float) -> Array:
        """Return the variances of the velocities at `now`, s: (N, 3) m²/s²."""
        return np.diagonal(self._carried(drones, now), axis1=1, axis2=2)[:, VELOCITY].copy()

    def covariance(self, drones: Drones, now: float) -> Array:
        """Return the (N, 3, 3) covariances of x, y (m) and heading (rad) at `now`, s."""
        planar = [0, 1, YAW]
        return self._carried(drones, now)[:, planar][:, :, planar]

    def take(self, drones: Drones, measured: Corrections | Ranges, now: float) -> None:
        """Correct the drones' estimates at `now`, s, with what was measured or sent to them."""
        rows = measured.agent
        change = _Change(self._carried(drones, now)[rows])
        position = drones["believed_position"][rows]
        if isinstance(measured, Ranges):
            for anchor, distance in zip(measured.anchors, measured.distance.T, strict=True):
                way = position - anchor
                expected = np.maximum(np.linalg.norm(way, axis=1), CLOSEST)
                heard = np.isfinite(distance)
                surprise = np.where(heard, distance - expected, 0.0)
                std = np.where(heard, measured.std, np.inf)
                change.absorb(POSITION, way / expected[:, None], surprise, std)
        else:
            for axis in range(3):
                surprise = measured.position[:, axis] - position[:, axis]
                change.absorb(axis, 1.0, surprise, measured.position_deviation)
            turn = yaw_from_quaternion(measured.attitude) - drones["believed_yaw"][rows]
            change.absorb(YAW, 1.0, wrap_angle(turn), measured.attitude_deviation)
        self._covariance[rows] = change.covariance
        self._correct(drones, rows, change.mean)
        self._note(drones, rows, now)

    def _correct(self, drones: Drones, rows: Rows, mean: Array) -> None:
        """Change estimates by (M, SIZE); a drone that stands with its motors off stands level."""
        drones["believed_position"][rows] += mean[:, POSITION]
        drones["believed_velocity"][rows] += mean[:, VELOCITY]
        yaw = drones["believed_yaw"][rows]
        cos, sin = np.cos(yaw), np.sin(yaw)
        east, north = mean[:, ACCELERATED].T / GRAVITY * (drones["mode"][rows] != OFF)
        drones["tilt_error"][rows] += np.stack(
            [sin * east - cos * north, cos * east + sin * north], axis=1
        )
        drones["believed_yaw"][rows] = wrap_angle(yaw + mean[:, YAW])

    def _note(self, drones: Drones, rows: Rows | int, now: float) -> None:
        self._time[rows] = now
        self._position[rows] = drones["believed_position"][rows]
        self._velocity[rows] = drones["believed_velocity"][rows]

    def _carried(self, drones: Drones, now: float) -> Array:
        """Return the covariances at `now`, s: (N, SIZE, SIZE).

        A wrong heading turns the accelerations since the last measurement.
        """
        passed = now - self._time
        gained = drones["believed_velocity"] - self._velocity
        moved = drones["believed_position"] - self._position - passed[:, None] * self._velocity
        carry = np.tile(np.eye(SIZE), (len(passed), 1, 1))
        for axis in range(3):
            carry[:, axis, 3 + axis] = carry[:, 3 + axis, 6 + axis] = passed
            carry[:, axis, 6 + axis] = passed**2 / 2
        carry[:, 0, YAW], carry[:, 1, YAW] = -moved[:, 1], moved[:, 0]
        carry[:, 3, YAW], carry[:, 4, YAW] = -gained[:, 1], gained[:, 0]
        carried = carry @ self._covariance @ carry.transpose(0, 2, 1)
        for axis in range(3):
            chain = slice(axis, 9, 3)
            carried[:, chain, chain] += TILT_GROWTH[axis] * _growth(passed, 3)
            chain = slice(axis, 6, 3)
            carried[:, chain, chain] += VELOCITY_GROWTH[axis] * _growth(passed, 2)
        carried[:, YAW, YAW] += YAW_GROWTH * passed
        return carried


class _Change:
    """What measurements change in estimates, one after the other.

    Args:
        covariance: (M, SIZE, SIZE) of the estimates, changed in place.

    Attributes:
        covariance: After the measurements.
        mean: (M, SIZE) to add to the estimates.
    """

    def __init__(self, covariance: Array) -> None:
        self.covariance = covariance
        self.mean = np.zeros(covariance.shape[:2])

    def absorb(
        self, columns: int | slice, along: Array | float, surprise: Array, std: Array
    ) -> None:
        """Absorb one scalar measurement of each estimate.

        Args:
            columns: Of the state, that it depends on.
            along: Its derivatives by these.
            surprise: (M,) measured less expected before the first measurement.
            std: (M,) standard deviation; infinite where nothing is measured.
        """
        direction = np.zeros_like(self.mean)
        direction[:, columns] = along
        spread = np.matvec(self.covariance, direction)
        gain = spread / (np.vecdot(direction, spread) + std**2)[:, None]
        self.mean += gain * (surprise - np.vecdot(direction, self.mean))[:, None]
        self.covariance -= gain[:, :, None] * spread[:, None, :]


def _growth(passed: Array, orders: int) -> Array:
    """Return the covariance of integrals of white noise of density 1 after some time.

    Args:
        passed: (N,) s.
        orders: How often it is integrated: the last one is its first integral.

    Returns:
        (N, orders, orders).

    Example:
        >>> _growth(np.array([1.0]), 2)
        array([[[0.33333333, 0.5       ],
                [0.5       , 1.        ]]])
    """
    power = np.arange(orders)[::-1]
    factor = np.array([1 / math.factorial(each) for each in power.tolist()])
    exponent = power[:, None] + power + 1
    return np.asarray(passed[:, None, None] ** exponent * np.outer(factor, factor) / exponent)
