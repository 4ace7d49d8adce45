"""What one agent's odometry says of its motion, and what better measures of it say."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Odometry, Rows

ROOM: Final = 1 << 13  # samples kept: 82 s at 100 Hz, well beyond the longest gap between fixes
COLUMNS: Final = 10  # time, velocity, yaw rate, roll, pitch, height, whether blind, whether still

STILL: Final = 0.05  # m/s: slower, an agent with its motors off stands
STILL_TURN: Final = math.radians(3.0)  # rad/s, likewise


class Motion(NamedTuple):
    """A motion from one time to a later one, as seen from its start.

    Attributes:
        shift: Displacement in x and y of the start's level body frame, m, as x + iy.
        turn: Change of yaw, rad.
        length: Way flown, m.
        duration: Time for which the agent did not stand, s.
        blind_length: Part of the way that nothing but the flow sensor measured, m.
        blind_duration: Likewise, s.
    """

    shift: complex
    turn: float
    length: float
    duration: float
    blind_length: float
    blind_duration: float


class Stance(NamedTuple):
    """How the agent stood and moved at one time.

    Attributes:
        roll: rad.
        pitch: rad, nose down positive.
        height: z in the odometry frame, m.
        velocity: (3,) in the level body frame, m/s.
        yaw_rate: rad/s.
    """

    roll: float
    pitch: float
    height: float
    velocity: Array
    yaw_rate: float


class Track:
    """Keeps the samples of one agent in order of time, and integrates them.

    A sample holds from the one before it to its own time. Samples that are not newer than the last
    one, or not finite, are passed over. Who stands stays where it is: what its sensors say then is
    their bias, which need not be that of the flight.
    """

    def __init__(self) -> None:
        self._rows = np.zeros((2 * ROOM, COLUMNS))
        self._end = 0

    def add(self, odometry: Odometry, rows: Rows, *, motors: bool = True) -> None:
        """Take in those samples of `odometry` that stand in `rows`.

        Args:
            odometry: With the agent's samples.
            rows: Which they are.
            motors: Whether its motors may run; off, it stands unless it is carried about.
        """
        still = np.full(len(rows), not motors)
        still &= np.abs(odometry.velocity[rows]).max(axis=1, initial=0.0) < STILL
        still &= np.abs(odometry.yaw_rate[rows]) < STILL_TURN
        table = np.column_stack(
            [
                odometry.time[rows],
                odometry.velocity[rows],
                odometry.yaw_rate[rows],
                odometry.roll[rows],
                odometry.pitch[rows],
                odometry.height[rows],
                np.ones(len(rows)),
                still,
            ]
        )
        table = table[np.isfinite(table).all(axis=1)]
        newer = np.maximum.accumulate(np.append(self.newest, table[:-1, 0])) < table[:, 0]
        table = table[newer][-ROOM:]
        self._make_room(len(table))
        self._rows[self._end : self._end + len(table)] = table
        self._end += len(table)

    @property
    def newest(self) -> float:
        """Time of the newest sample, s; -inf if there is none."""
        return float(self._rows[self._end - 1, 0]) if self._end else -np.inf

    def between(
        self, begin: float, end: float, *, scale: complex = 1.0, yaw_bias: float = 0.0
    ) -> Motion:
        """Integrate from `begin` to `end`, s; beyond the newest sample its motion goes on.

        Args:
            begin: s.
            end: s, no earlier than `begin`.
            scale: What to multiply velocities by: how much longer the way is than the flow sensor
                says, and how it is turned in the body.
            yaw_bias: What to take from the yaw rate, rad/s.
        """
        times = self._rows[: self._end, 0]
        if end <= begin or not len(times):
            still = max(0.0, end - begin)
            return Motion(0j, 0.0, 0.0, still, 0.0, still)
        first = min(int(np.searchsorted(times, begin, side="right")), len(times) - 1)
        last = min(int(np.searchsorted(times, end)), len(times) - 1)
        rows = self._rows[first : last + 1]
        until = np.clip(rows[:, 0], begin, end)
        until[-1] = end
        took = np.diff(until, prepend=begin) * (1 - rows[:, 9])
        turns = (rows[:, 4] - yaw_bias) * took
        after = np.cumsum(turns)
        steps = scale * (rows[:, 1] + 1j * rows[:, 2]) * took
        lengths, blind = np.abs(steps), rows[:, 8]
        return Motion(
            shift=complex(np.exp(1j * (after - turns / 2)) @ steps),
            turn=float(after[-1]),
            length=float(lengths.sum()),
            duration=float(took.sum()),
            blind_length=float(lengths @ blind),
            blind_duration=float(took @ blind),
        )

    def correct(self, begin: float, end: float, shift: complex, *, yaw_bias: float) -> None:
        """Make the way between two times what something better than the flow sensor measured.

        Velocities in the body change by one and the same amount; turns stay what they are. If
        there are no samples up to `end` yet, nothing changes.

        Args:
            begin: s.
            end: s.
            shift: As `between` returns it for these times and this yaw bias, m.
            yaw_bias: What to take from the yaw rate, rad/s.
        """
        if not begin < end <= self.newest:
            return
        self._make_room(2)
        rows = self._rows[self._cut(begin) : self._cut(end)]
        took = np.diff(rows[:, 0], prepend=begin)
        turns = (rows[:, 4] - yaw_bias) * took
        turned = np.exp(1j * (np.cumsum(turns) - turns / 2)) * took
        more = complex((shift - turned @ (rows[:, 1] + 1j * rows[:, 2])) / turned.sum())
        rows[:, 1] += more.real
        rows[:, 2] += more.imag
        rows[:, 8:] = 0.0

    def _cut(self, time: float) -> int:
        """Let a sample end at `time`, s, no later than the newest; return the row after it."""
        row = int(np.searchsorted(self._rows[: self._end, 0], time))
        if self._rows[row, 0] != time:
            self._rows[row + 1 : self._end + 1] = self._rows[row : self._end].copy()
            self._rows[row, 0] = time
            self._end += 1
        return row + 1

    def _make_room(self, more: int) -> None:
        """Forget old samples if there is no room for that many more."""
        if self._end + more > len(self._rows):
            kept = self._rows[self._end - ROOM : self._end].copy()
            self._end = len(kept)
            self._rows[: self._end] = kept

    def at(self, time: float) -> Stance:
        """Return the sample that holds at `time`, s; level and at rest if there is none."""
        times = self._rows[: self._end, 0]
        if not len(times):
            return Stance(0.0, 0.0, 0.0, np.zeros(3), 0.0)
        row = self._rows[min(int(np.searchsorted(times, time)), len(times) - 1)]
        return Stance(float(row[5]), float(row[6]), float(row[7]), row[1:4], float(row[4]))
