"""Motions that scripts command: where an agent should be, and how it moves, at any time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from star_core import Array
from star_core.toolkit import polynomial, wrap_angle

SETPOINT_TIMEOUT: Final = 0.5  # s without a setpoint, after which the firmware levels a drone

# The last four coefficients of a polynomial of order 7 on [0, 1], from what its end lacks in value
# and its first three derivatives when the first four coefficients are given.
_ENDING: Final = np.linalg.inv(
    np.array([[1, 1, 1, 1], [4, 5, 6, 7], [12, 20, 30, 42], [24, 60, 120, 210]], float)
)


class State(NamedTuple):
    """State of a motion.

    Attributes:
        position: (3,) m.
        velocity: (3,) m/s.
        acceleration: (3,) m/s²; NaN if it is not known, as of a motion that has ended.
        yaw: rad.
        yaw_rate: rad/s.
    """

    position: Array
    velocity: Array
    acceleration: Array
    yaw: float
    yaw_rate: float


class Motion(Protocol):
    """A motion of one agent.

    Attributes:
        end: Mission time at which it ends, s.
        line: Where the script commands it, ``file:line``.
    """

    @property
    def end(self) -> float:
        """When it ends."""

    @property
    def line(self) -> str:
        """Where it is commanded."""

    def at(self, time: float) -> State:
        """Return its state at a mission time, s."""
        ...


@dataclass(frozen=True, slots=True)
class Hold:
    """Hovers at a position, (3,) m, with a heading, rad."""

    position: Array
    yaw: float
    line: str = ""
    end: float = -math.inf

    def at(self, time: float) -> State:
        return State(self.position, np.zeros(3), np.full(3, np.nan), self.yaw, 0.0)


class GoTo:
    """Flies to a position and comes to rest, by a polynomial as the firmware's planner makes it.

    Args:
        start: State at its beginning.
        position: (3,) of its end, m.
        yaw: Heading at its end, rad.
        begin: Mission time, s.
        duration: s.
        line: Where it is commanded.
    """

    def __init__(
        self, start: State, position: Array, yaw: float, begin: float, duration: float, line: str
    ) -> None:
        self.line, self._begin, self.end = line, begin, begin + duration
        self._position, self._yaw = position, yaw
        self._rest = Hold(position, yaw, line)
        value = np.append(start.position, start.yaw)
        target = np.append(position, start.yaw + wrap_angle(yaw - start.yaw))
        slope = duration * np.append(start.velocity, 0.0)
        half = duration**2 / 2 * np.append(np.nan_to_num(start.acceleration), 0.0)
        lacking = np.stack([target - value - slope - half, -slope - 2 * half, -2 * half, 0 * value])
        self._coefficients = np.vstack([value, slope, half, 0 * value, _ENDING @ lacking])  # (8, 4)
        self._duration = duration

    def at(self, time: float) -> State:
        if time >= self.end:
            return self._rest.at(time)
        share = max(0.0, (time - self._begin) / self._duration)
        return _state(*polynomial(self._coefficients, share), 1 / self._duration)


class Flown:
    """Flies polynomial pieces, as an uploaded trajectory is flown.

    Args:
        pieces: Duration, s, and (4, K) coefficients of x, y, z and yaw of each, the constant first.
        start: State at its beginning, at which a relative trajectory begins.
        begin: Mission time, s.
        timescale: Factor by which its duration is stretched.
        reverse: Whether it is flown from its end to its beginning.
        relative: Whether its positions are shifted so that it begins at those of `start`.
        line: Where it is commanded.
    """

    def __init__(
        self,
        pieces: Sequence[tuple[float, Array]],
        start: State,
        begin: float,
        *,
        timescale: float,
        reverse: bool,
        relative: bool,
        line: str,
    ) -> None:
        self.line, self._begin = line, begin
        self._pieces, self._scale, self._reverse = pieces, timescale, reverse
        self._length = sum(duration for duration, _ in pieces)
        self.end = begin + timescale * self._length
        self._shift = np.zeros(4)
        if relative:
            self._shift[:3] = start.position - self._value(0.0)[0][:3]

    def at(self, time: float) -> State:
        passed = min(max(0.0, (time - self._begin) / self._scale), self._length)
        value, first, second = self._value(passed)
        value = value + self._shift
        if time >= self.end:
            return Hold(value[:3], float(value[3]), self.line).at(time)
        return _state(value, first, second, 1 / self._scale)

    def _value(self, passed: float) -> tuple[Array, Array, Array]:
        """Return (4,) values, first and second derivatives after a time of its own, s."""
        sign = -1.0 if self._reverse else 1.0
        left = self._length - passed if self._reverse else passed
        duration, coefficients = self._pieces[-1]
        for duration, coefficients in self._pieces:  # noqa: B007 -- the last one stays
            if left <= duration:
                break
            left -= duration
        value, first, second = polynomial(coefficients.T, min(left, duration))
        return value, sign * first, second


class Streamed:
    """Flies setpoints of states: the last one moves on for a while.

    Args:
        state: Of the setpoint.
        time: Mission time at which it came, s.
        line: Where it is sent.
    """

    def __init__(self, state: State, time: float, line: str) -> None:
        self.line, self._state, self._time = line, state, time
        self.end = time + SETPOINT_TIMEOUT

    def at(self, time: float) -> State:
        passed = min(time - self._time, SETPOINT_TIMEOUT)
        now, change = self._state, passed * np.nan_to_num(self._state.acceleration)
        position = now.position + passed * (now.velocity + change / 2)
        yaw = now.yaw + passed * now.yaw_rate
        return now._replace(position=position, velocity=now.velocity + change, yaw=yaw)


class Steered:
    """Flies setpoints of velocities, without a position of their own.

    Args:
        position: (3,) of the agent when it came, m.
        velocity: (3,) in the map, m/s; ahead and aside of the heading if `in_body`.
        yaw: Heading, rad.
        yaw_rate: rad/s.
        time: Mission time, s.
        line: Where it is sent.
        height: To keep, m; None flies the vertical velocity.
        in_body: Whether the horizontal velocity turns with the agent.
    """

    def __init__(
        self,
        position: Array,
        velocity: Array,
        yaw: float,
        yaw_rate: float,
        time: float,
        line: str,
        *,
        height: float | None = None,
        in_body: bool = False,
    ) -> None:
        self.line, self.end, self.height = line, time + SETPOINT_TIMEOUT, height
        self._position, self._velocity, self._in_body = position, velocity, in_body
        self._yaw, self._yaw_rate, self._time = yaw, yaw_rate, time

    def at(self, time: float) -> State:
        passed = min(time - self._time, SETPOINT_TIMEOUT)
        yaw = self._yaw + passed * self._yaw_rate
        velocity = self._velocity.copy()
        if self._in_body:
            ahead, aside = self._velocity[:2]
            velocity[0] = math.cos(yaw) * ahead - math.sin(yaw) * aside
            velocity[1] = math.sin(yaw) * ahead + math.cos(yaw) * aside
        position = self._position + passed * velocity
        return State(position, velocity, np.full(3, np.nan), yaw, self._yaw_rate)


def _state(value: Any, first: Any, second: Any, rate: float) -> State:
    """Return a state from values of x, y, z and yaw and their derivatives by scaled time."""
    first, second = rate * first, rate**2 * second
    return State(value[:3], first[:3], second[:3], float(value[3]), float(first[3]))
