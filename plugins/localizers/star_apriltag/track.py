"""What one agent's odometry says of its motion."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Odometry, Rows

ROOM: Final = 1 << 13  # samples kept: 82 s at 100 Hz, well beyond the longest gap between fixes


class Motion(NamedTuple):
    """A motion from one time to a later one, as seen from its start.

    Attributes:
        shift: Displacement in x and y of the start's level body frame, m, as x + iy.
        turn: Change of yaw, rad.
        length: Way flown, m.
        duration: s.
    """

    shift: complex
    turn: float
    length: float
    duration: float


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
    one, or not finite, are passed over.
    """

    def __init__(self) -> None:
        self._rows = np.zeros((2 * ROOM, 8))
        self._end = 0

    def add(self, odometry: Odometry, rows: Rows) -> None:
        """Take in those samples of `odometry` that stand in `rows`."""
        table = np.column_stack(
            [
                odometry.time[rows],
                odometry.velocity[rows],
                odometry.yaw_rate[rows],
                odometry.roll[rows],
                odometry.pitch[rows],
                odometry.height[rows],
            ]
        )
        table = table[np.isfinite(table).all(axis=1)]
        newer = np.maximum.accumulate(np.append(self.newest, table[:-1, 0])) < table[:, 0]
        table = table[newer][-ROOM:]
        if self._end + len(table) > len(self._rows):
            kept = self._rows[self._end - ROOM : self._end].copy()
            self._end = len(kept)
            self._rows[: self._end] = kept
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
            return Motion(0j, 0.0, 0.0, max(0.0, end - begin))
        first = min(int(np.searchsorted(times, begin, side="right")), len(times) - 1)
        last = min(int(np.searchsorted(times, end)), len(times) - 1)
        rows = self._rows[first : last + 1]
        until = np.clip(rows[:, 0], begin, end)
        until[-1] = end
        took = np.diff(until, prepend=begin)
        turns = (rows[:, 4] - yaw_bias) * took
        after = np.cumsum(turns)
        steps = scale * (rows[:, 1] + 1j * rows[:, 2]) * took
        return Motion(
            shift=complex(np.exp(1j * (after - turns / 2)) @ steps),
            turn=float(after[-1]),
            length=float(np.abs(steps).sum()),
            duration=end - begin,
        )

    def at(self, time: float) -> Stance:
        """Return the sample that holds at `time`, s; level and at rest if there is none."""
        times = self._rows[: self._end, 0]
        if not len(times):
            return Stance(0.0, 0.0, 0.0, np.zeros(3), 0.0)
        row = self._rows[min(int(np.searchsorted(times, time)), len(times) - 1)]
        return Stance(float(row[5]), float(row[6]), float(row[7]), row[1:4], float(row[4]))
