"""Control along trajectories: velocities that lead to them, and what makes up for drones' lags."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.state import Estimate, Goals, Setpoint

GRAVITY: Final = 9.81  # m/s²
VELOCITY_GAIN: Final = GRAVITY * math.tan(math.radians(25.0))  # 1/s, PID_VEL_X_KP of the firmware
VELOCITY_INTEGRAL: Final = GRAVITY * math.radians(1.0)  # 1/s², PID_VEL_X_KI
VELOCITY_DELAY: Final = 0.04  # s, with which trajectories of up to 1.2 m/s are followed best
STATE_DELAY: Final = 0.06  # s, the same of full states under the firmware's Mellinger controller
TILT_LAG: Final = 0.1  # s, with which an acceleration follows its command: the drone has to tilt
MAX_BIAS: Final = 0.15  # m, along each axis, between a trajectory and the position that is sent

MAX_LEAD: Final = 0.3  # m; an agent farther from the point of its trajectory does not follow it
TRACKING_GAIN: Final = 2.2  # 1/s: more makes the loop with a lag of 0.3 s overshoot
OBSERVER: Final = 6.0  # 1/s, with which the drift of a velocity is followed
MOST_OBSERVED: Final = 0.5  # share of an error that a tick corrects at most, for slow ticks


class Tracking:
    """Velocities that lead agents along trajectories.

    The velocity is the trajectory's, and `TRACKING_GAIN` times the distance from its point. A drone
    that misjudges its velocity, by the scale of its flow sensor over a floor, leaves a trajectory
    in proportion to its speed. A Luenberger observer estimates by how much from positions that the
    estimated velocities do not lead to, and that is subtracted.

    Args:
        n: Number of agents.
        period: Of the ticks, s.
    """

    def __init__(self, n: int, period: float) -> None:
        self._period = period
        self._rate = min(OBSERVER, MOST_OBSERVED / period)
        self._position, self._velocity = np.zeros((n, 3)), np.zeros((n, 3))
        self._drift = np.zeros((n, 3))  # m/s
        self._rows = self._none = np.zeros((n, 1), np.bool_)

    def forget(self) -> None:
        """Note that no agent follows a trajectory."""
        self._rows = self._none

    def velocity(self, estimate: Estimate, goals: Goals, rows: Mask) -> Array:
        """Return the (N, 3) velocity to fly, m/s, of agents that follow trajectories.

        Args:
            estimate: Where the agents are.
            goals: Points of the trajectories, and their velocities.
            rows: (N,) these agents; the observer begins where they follow one.
        """
        mean = (self._velocity + estimate.velocity) / 2
        position = self._position + self._period * (mean + self._drift)
        error = np.where(self._rows, estimate.position - position, 0.0)
        drift = np.where(self._rows, self._drift + self._rate**2 * self._period * error, 0.0)
        position = np.where(self._rows, position, estimate.position)
        self._position = position + 2 * self._rate * self._period * error
        self._velocity, self._drift, self._rows = estimate.velocity, drift, rows[:, None]
        away = goals.position - estimate.position
        velocity: Array = goals.velocity + TRACKING_GAIN * away - drift
        return velocity


class _Jerk:
    """Estimates jerks from accelerations of successive setpoints.

    Args:
        n: Number of agents.
        period: Of the ticks, s.
    """

    def __init__(self, n: int, period: float) -> None:
        self._period = period
        self._last = np.full((n, 3), np.nan)  # m/s²

    def change(self, acceleration: Array) -> tuple[Array, Mask]:
        """Return (N, 3) changes since the last setpoint, m/s², and which (N, 3) begin now.

        Args:
            acceleration: (N, 3) m/s²; NaN without a trajectory.
        """
        change = acceleration - self._last
        begins = np.isnan(change)
        change[begins] = 0.0
        self._last = acceleration
        return change, begins


class VelocityLead:
    """Velocities for drones whose velocity control lags.

    The control is taken to command the acceleration ``K e + I sum(e)`` for an error e of the
    velocity, and the drone to have it `TILT_LAG` later. Such a drone follows a trajectory of
    velocity v, acceleration a and jerk j without lag when it is sent ``v + t a + h / K``: t is the
    delay, and h is ``a + TILT_LAG j`` less what the integral adds, a high pass of the time constant
    K / I. The jerk is that since the last tick.

    Args:
        n: Number of agents.
        period: Of the ticks, s.
        gain: K, 1/s; by default that of the firmware's PID controller, like the next two.
        integral: I, 1/s².
        delay: t, s, without the half tick for which a velocity is held on average.
    """

    def __init__(
        self,
        n: int,
        period: float,
        *,
        gain: float = VELOCITY_GAIN,
        integral: float = VELOCITY_INTEGRAL,
        delay: float = VELOCITY_DELAY,
    ) -> None:
        self._period, self._gain, self._delay = period, gain, delay + period / 2
        self._kept = 1.0 - period * integral / gain
        self._jerk = _Jerk(n, period)
        self._passed = np.zeros((n, 3))  # m/s²

    def velocity(self, setpoint: Setpoint) -> Array:
        """Return (N, 3) velocities to send, m/s; those of the setpoint without a trajectory."""
        if setpoint.acceleration is None:
            return setpoint.velocity
        now = np.where(setpoint.followed()[:, None], setpoint.acceleration, np.nan)
        change, begins = self._jerk.change(now)
        self._passed = np.where(begins, now, self._kept * self._passed + change)
        lead = self._delay * now + (self._passed + TILT_LAG / self._period * change) / self._gain
        velocity: Array = setpoint.velocity + np.nan_to_num(lead)
        return velocity


class FullStates:
    """Full states, for drones that track positions, velocities and accelerations.

    The position that is sent moves by the velocities of the setpoints, which lead to the
    trajectory, and stays within `MAX_BIAS` of it: so it makes up for what holds the drone beside
    it, such as a mass that its controller does not know. The states are ahead by `STATE_DELAY` and
    half a tick.

    Args:
        n: Number of agents.
        period: Of the ticks, s.

    Attributes:
        position: (N, 3) that was sent last, not ahead, m.
        rows: (N,) agents that follow a trajectory.
    """

    def __init__(self, n: int, period: float) -> None:
        self._period, self._ahead = period, STATE_DELAY + period / 2
        self._jerk = _Jerk(n, period)
        self._velocity = np.zeros((n, 3))
        self.position = np.zeros((n, 3))
        self.rows: Mask = np.zeros(n, np.bool_)

    def advance(self, setpoint: Setpoint, rows: Mask, begin: Array) -> tuple[Array, Array, Array]:
        """Return (N, 3) positions, m, velocities, m/s, and accelerations, m/s², to send.

        Args:
            setpoint: With trajectories in some rows, in the frame of the result.
            rows: (N,) which of these follow them.
            begin: (N, 3) positions that were sent to rows that did not follow before, m.
        """
        if setpoint.position is None or setpoint.acceleration is None:
            self.rows = np.zeros_like(rows)
            return begin, setpoint.velocity, np.zeros_like(begin)
        column = rows[:, None]
        acceleration = np.where(column, setpoint.acceleration, np.nan)
        change, _ = self._jerk.change(acceleration)
        moved = self.position + self._period * self._velocity
        bias = np.where(self.rows[:, None], moved, begin) - setpoint.position
        self.position = setpoint.position + np.minimum(np.maximum(bias, -MAX_BIAS), MAX_BIAS)
        self.rows, self._velocity = rows, setpoint.velocity
        return (
            self.position + self._ahead * setpoint.velocity,
            setpoint.velocity + self._ahead * np.nan_to_num(acceleration),
            np.nan_to_num(acceleration + TILT_LAG / self._period * change),
        )
