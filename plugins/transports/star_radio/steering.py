"""How setpoints are put to drones: as velocities, or as whole states that move along with them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Final, Protocol

import numpy as np

from star_core import Array, Mask, Setpoint
from star_radio import orders, report
from star_radio.heading import yaw_rate
from star_radio.packets import FARTHEST

LEASH: Final = 0.15  # m: how far a state may be from where its drone reports to be
TWIST: Final = 0.5  # rad: how far its heading may be from the drone's
PAUSE: Final = 0.5  # s without a setpoint, after which the firmware levels out
_STILL: Final = (0.0, 0.0, 0.0)


class Steering(Protocol):
    """Packs the setpoints of a swarm."""

    def packets(
        self, setpoint: Setpoint, reported: Array, versions: Sequence[int]
    ) -> dict[int, bytes]:
        """Return a packet for each active row, by row.

        Args:
            setpoint: Velocities and headings in odometry frames, finite where active.
            reported: (N, 13) what drones reported last: columns of `star_radio.report`.
            versions: Of the protocol that each speaks.
        """
        ...


class Velocities:
    """Each drone is sent a velocity, and a yaw rate that turns it to its heading."""

    def packets(
        self, setpoint: Setpoint, reported: Array, versions: Sequence[int]
    ) -> dict[int, bytes]:
        rates = yaw_rate(setpoint.yaw, reported[:, report.YAW]).tolist()
        velocities = setpoint.velocity.tolist()
        return {
            row: orders.velocity(velocities[row], rates[row], versions[row])
            for row in np.flatnonzero(setpoint.active).tolist()
        }


class WholeStates:
    """Each drone is sent a position that moves at its velocity, and that; a heading and its rate.

    The position begins where the drone is and stays within `LEASH` of it, so that one who cannot
    keep up is not called to where it should have been; the heading, which turns as `yaw_rate` has
    it, within `TWIST`. The acceleration is 0: until the next tick a velocity is constant. Who is
    left out of a setpoint begins anew, and everybody after a `PAUSE` without one. A state that
    cannot be sent, for a drone reports no place or one too far, goes as a velocity.

    Args:
        n: Agents.
        now: Says what time it is, s.
    """

    def __init__(self, n: int, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._then = 0.0
        self._flown: Mask = np.zeros(n, np.bool_)
        self._position, self._velocity = np.zeros((n, 3)), np.zeros((n, 3))
        self._yaw = np.zeros(n)
        self._velocities = Velocities()

    def packets(
        self, setpoint: Setpoint, reported: Array, versions: Sequence[int]
    ) -> dict[int, bytes]:
        rates = self._advance(setpoint, reported)
        packed = self._velocities.packets(setpoint, reported, versions)
        fits = np.isfinite(self._yaw) & (abs(self._position) <= FARTHEST).all(axis=1)
        self._flown = setpoint.active & fits
        for row in np.flatnonzero(self._flown).tolist():
            half = float(self._yaw[row]) / 2
            packed[row] = orders.full_state(
                self._position[row].tolist(),
                setpoint.velocity[row].tolist(),
                _STILL,
                (0.0, 0.0, math.sin(half), math.cos(half)),
                (0.0, 0.0, float(rates[row])),
            )
        return packed

    def _advance(self, setpoint: Setpoint, reported: Array) -> Array:
        """Move every state on to now; return the (N,) yaw rates from here, rad/s."""
        here, heading = reported[:, [report.X, report.Y, report.Z]], reported[:, report.YAW]
        now = self._now()
        passed, self._then = now - self._then, now
        lead = self._position + passed * self._velocity - here
        away = np.linalg.norm(lead, axis=1, keepdims=True)
        lead *= LEASH / np.maximum(away, LEASH)
        ahead = self._yaw + passed * yaw_rate(setpoint.yaw, self._yaw) - heading
        twist = np.clip(np.remainder(ahead + math.pi, math.tau) - math.pi, -TWIST, TWIST)
        goes_on = self._flown & np.isfinite(lead).all(axis=1) & (passed < PAUSE)
        self._position = np.where(goes_on[:, None], here + lead, here)
        self._yaw = np.where(goes_on, heading + twist, heading)
        self._velocity = setpoint.velocity
        return yaw_rate(setpoint.yaw, self._yaw)
