"""Setpoints and heading control: as velocities, or as full states that advance with time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from star_core import Array, Mask, Setpoint
from star_core.toolkit import FullStates, VelocityLead, wrap_angle
from star_radio import orders, report
from star_radio.connection.packets import MAX_COORDINATE

GAIN: Final = 3.0  # 1/s; well below the bandwidth of the firmware's yaw-rate loop
MAX_YAW_RATE: Final = 2.0  # rad/s
MAX_LEAD: Final = 0.15  # m, between the commanded and the reported position
MAX_YAW_LEAD: Final = 0.5  # rad, between the commanded and the reported heading
SETPOINT_TIMEOUT: Final = 0.5  # s without a setpoint, after which the firmware levels out


def yaw_rate(target: Array, yaw: Array) -> Array:
    """Return the (N,) yaw rates that turn agents to their headings the shorter way, rad/s.

    The rate is ``GAIN`` times the heading error, at most `MAX_YAW_RATE`: the same law as in the
    simulator. It is 0 where the heading is unknown (NaN).

    Args:
        target: (N,) rad.
        yaw: (N,) as reported, rad.

    Example:
        >>> yaw_rate(np.array([0.1, 3.0, 1.0]), np.array([0.0, -3.0, np.nan])).round(3)
        array([ 0.3 , -0.85,  0.  ])
    """
    rate = np.clip(GAIN * wrap_angle(target - yaw), -MAX_YAW_RATE, MAX_YAW_RATE)
    return np.where(np.isnan(rate), 0.0, rate)


class Velocities:
    """Sends each drone a velocity and a yaw rate that turns it to its heading.

    Velocities along trajectories make up for the lag of the firmware's PID controller, for ticks
    of `period`, s.
    """

    def __init__(self, n: int, period: float) -> None:
        self._lead = VelocityLead(n, period)

    def packets(
        self, setpoint: Setpoint, reported: Array, versions: Sequence[int]
    ) -> dict[int, bytes]:
        """Return a packet for each active row, by row.

        Args:
            setpoint: Velocities and headings in odometry frames, finite where active.
            reported: (N, 13) newest reports: columns of `star_radio.report`.
            versions: Protocol version of each drone.
        """
        rates = _with_rate(yaw_rate(setpoint.yaw, reported[:, report.YAW]), setpoint).tolist()
        velocities = self._lead.velocity(setpoint).tolist()
        return {
            row: orders.velocity(velocities[row], rates[row], versions[row])
            for row in np.flatnonzero(setpoint.active).tolist()
        }


def _with_rate(rate: Array, setpoint: Setpoint) -> Array:
    """Return (N,) yaw rates with those of the trajectories that agents follow added, rad/s."""
    if setpoint.yaw_rate is None:
        return rate
    feedforward = np.where(setpoint.followed(), np.nan_to_num(setpoint.yaw_rate), 0.0)
    sum_: Array = np.clip(rate + feedforward, -MAX_YAW_RATE, MAX_YAW_RATE)
    return sum_


class WholeStates:
    """Sends each drone a position that moves at its velocity, the velocity, a heading and its rate.

    The position starts at the drone's and stays within `MAX_LEAD` of it, so that a drone that
    lags does not rush to catch up; the heading, which turns as in `yaw_rate`, stays within
    `MAX_YAW_LEAD`. The acceleration is 0: the velocity is constant until the next tick. Agents that
    follow trajectories get the states of `FullStates` instead. The state
    is reset for a row that is inactive in a setpoint, and for all rows after `SETPOINT_TIMEOUT`
    without one. A state that cannot be encoded, because the reported position is missing or too
    far away, is sent as a velocity.
    """

    def __init__(self, n: int, period: float, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._then = 0.0
        self._flown: Mask = np.zeros(n, np.bool_)
        self._position, self._velocity = np.zeros((n, 3)), np.zeros((n, 3))
        self._yaw = np.zeros(n)
        self._velocities = Velocities(n, period)
        self._states = FullStates(n, period)

    def packets(
        self, setpoint: Setpoint, reported: Array, versions: Sequence[int]
    ) -> dict[int, bytes]:
        """Return a packet for each active row, by row, from what `Velocities.packets` takes."""
        rates = _with_rate(self._advance(setpoint, reported), setpoint)
        packed = self._velocities.packets(setpoint, reported, versions)
        fits = np.isfinite(self._yaw) & (abs(self._position) <= MAX_COORDINATE).all(axis=1)
        self._flown = setpoint.active & fits
        position, velocity, acceleration = self._states.advance(
            setpoint, self._flown & setpoint.followed(), self._position
        )
        followed = self._states.rows[:, None]
        self._position = np.where(followed, self._states.position, self._position)
        position = np.where(followed, position, self._position)
        velocity = np.where(followed, velocity, setpoint.velocity)
        for row in np.flatnonzero(self._flown).tolist():
            half = float(self._yaw[row]) / 2
            packed[row] = orders.full_state(
                position[row].tolist(),
                velocity[row].tolist(),
                acceleration[row].tolist(),
                (0.0, 0.0, math.sin(half), math.cos(half)),
                (0.0, 0.0, float(rates[row])),
            )
        return packed

    def _advance(self, setpoint: Setpoint, reported: Array) -> Array:
        """Advance all states to the present; return their (N,) yaw rates, rad/s."""
        position, heading = reported[:, [report.X, report.Y, report.Z]], reported[:, report.YAW]
        now = self._now()
        passed, self._then = now - self._then, now
        lead = self._position + passed * self._velocity - position
        distance = np.linalg.norm(lead, axis=1, keepdims=True)
        lead *= MAX_LEAD / np.maximum(distance, MAX_LEAD)
        ahead = self._yaw + passed * yaw_rate(setpoint.yaw, self._yaw) - heading
        yaw_lead = np.clip(wrap_angle(ahead), -MAX_YAW_LEAD, MAX_YAW_LEAD)
        continues = self._flown & np.isfinite(lead).all(axis=1) & (passed < SETPOINT_TIMEOUT)
        self._position = np.where(continues[:, None], position + lead, position)
        self._yaw = np.where(continues, heading + yaw_lead, heading)
        self._velocity = setpoint.velocity
        return yaw_rate(setpoint.yaw, self._yaw)
