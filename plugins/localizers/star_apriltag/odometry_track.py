"""One agent's odometry, integrated, and corrected by better measurements."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Odometry, Rows

CAPACITY: Final = 1 << 13  # samples: 82 s at 100 Hz, well beyond the longest gap between fixes
COLUMNS: Final = 10  # time, velocity, yaw rate, roll, pitch, height, whether blind, whether at rest

MAX_REST_SPEED: Final = 0.05  # m/s, of an agent at rest with its motors off
MAX_REST_RATE: Final = math.radians(3.0)  # rad/s, likewise


class Motion(NamedTuple):
    """A motion from one time to a later one, relative to its start."""

    shift: complex  # displacement in x and y of the start's level body frame, m, as x + iy
    turn: float  # change of yaw, rad
    length: float  # of the path, m
    duration: float  # without the time at rest, s
    blind_length: float  # length that only the flow sensor measured, m
    blind_duration: float  # likewise, s


class OdometrySample(NamedTuple):
    """Attitude, height and motion of the agent at one time."""

    roll: float  # rad
    pitch: float  # rad, nose down positive
    height: float  # z in the odometry frame, m
    velocity: Array  # (3,) in the level body frame, m/s
    yaw_rate: float  # rad/s


class OdometryTrack:
    """Keeps the samples of one agent in order of time, and integrates them.

    A sample is valid from the one before it to its own time. Samples that are not newer than the
    last one, or not finite, are ignored. An agent at rest does not move: its sensors then show
    their bias, which need not be that of the flight.
    """

    def __init__(self) -> None:
        self._rows = np.zeros((2 * CAPACITY, COLUMNS))
        self._end = 0

    def add(self, odometry: Odometry, rows: Rows, *, motors: bool = True) -> None:
        """Add the samples in `rows` of `odometry`.

        Args:
            odometry: With the agent's samples.
            rows: Of the agent.
            motors: Whether its motors may run; off, it is at rest unless it is carried.
        """
        rests = np.full(len(rows), not motors)
        rests &= np.abs(odometry.velocity[rows]).max(axis=1, initial=0.0) < MAX_REST_SPEED
        rests &= np.abs(odometry.yaw_rate[rows]) < MAX_REST_RATE
        table = np.column_stack(
            [
                odometry.time[rows],
                odometry.velocity[rows],
                odometry.yaw_rate[rows],
                odometry.roll[rows],
                odometry.pitch[rows],
                odometry.height[rows],
                np.ones(len(rows)),
                rests,
            ]
        )
        table = table[np.isfinite(table).all(axis=1)]
        newer = np.maximum.accumulate(np.append(self.newest, table[:-1, 0])) < table[:, 0]
        table = table[newer][-CAPACITY:]
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
        """Integrate from `begin` to `end`, s; the newest sample's motion continues after it.

        Args:
            begin: s.
            end: s, no earlier than `begin`.
            scale: Factor of velocities: scale and misalignment of the flow sensor.
            yaw_bias: Subtracted from the yaw rate, rad/s.
        """
        times = self._rows[: self._end, 0]
        if end <= begin or not len(times):
            duration = max(0.0, end - begin)
            return Motion(0j, 0.0, 0.0, duration, 0.0, duration)
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
        """Replace the displacement between two times by a better measurement.

        All velocities in the body change by the same amount; turns do not change. Without samples
        up to `end`, nothing changes.

        Args:
            begin: s.
            end: s.
            shift: As `between` returns it for these times and this yaw bias, m.
            yaw_bias: Subtracted from the yaw rate, rad/s.
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
        """Split a sample at `time`, s, no later than the newest; return the row after it."""
        row = int(np.searchsorted(self._rows[: self._end, 0], time))
        if self._rows[row, 0] != time:
            self._rows[row + 1 : self._end + 1] = self._rows[row : self._end].copy()
            self._rows[row, 0] = time
            self._end += 1
        return row + 1

    def _make_room(self, more: int) -> None:
        """Drop old samples if there is no room for that many more."""
        if self._end + more > len(self._rows):
            kept = self._rows[self._end - CAPACITY : self._end].copy()
            self._end = len(kept)
            self._rows[: self._end] = kept

    def at(self, time: float) -> OdometrySample:
        """Return the sample that is valid at `time`, s; level and at rest if there is none."""
        times = self._rows[: self._end, 0]
        if not len(times):
            return OdometrySample(0.0, 0.0, 0.0, np.zeros(3), 0.0)
        row = self._rows[min(int(np.searchsorted(times, time)), len(times) - 1)]
        roll, pitch, height = row[5:8].tolist()
        return OdometrySample(roll, pitch, height, row[1:4], float(row[4]))
