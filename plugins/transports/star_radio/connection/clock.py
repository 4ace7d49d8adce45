"""Conversion of a Crazyflie's timestamps to the computer's clock."""

from __future__ import annotations

import math
from typing import Final

WRAP: Final = 1 << 24  # ms: timestamps have 24 bits and wrap after 4.7 h
WINDOW: Final = 2.0  # s: at least 20 reports; a clock that falls behind is followed within two
MIN_RESTART_STEP: Final = 1000  # ms, backward step that means a restart: no packet is so late


class Clock:
    """Estimates the offset of a drone's clock as the minimum of arrival time minus timestamp.

    That difference is the offset plus a positive delay, so its minimum is closest to the offset (as
    in Cristian, Distributed Computing 3, 1989). Only the current and the previous `WINDOW` are
    used, so that the offset follows clock drift (40 ppm are 0.2 ms in two windows) and a simulated
    drone that cannot keep up with real time. The remaining error is the minimum latency of the
    link, some milliseconds, by which times are late.

    Attributes:
        restarted: Whether the drone's clock has restarted since its first report.
    """

    def __init__(self) -> None:
        self.restarted = False
        self._last: int | None = None  # ms, newest timestamp, unwrapped
        self._began = 0.0  # s, start of the current window
        self._offset = self._before = math.inf  # s, of the current and the previous window

    def time(self, stamp: int, arrived: float) -> float:
        """Return the time of a report, s of the computer's clock, never after its arrival.

        Args:
            stamp: Timestamp of the report, ms since the drone started, 24 bits.
            arrived: Arrival of the report, s.
        """
        last = stamp if self._last is None else self._last
        step = (stamp - last + WRAP // 2) % WRAP - WRAP // 2
        if self._last is None or step < -MIN_RESTART_STEP:
            self.restarted |= self._last is not None
            last, step = stamp, 0
            self._last, self._began = stamp, arrived
            self._offset = self._before = math.inf
        unwound = last + step
        self._last = max(last, unwound)
        if arrived - self._began > WINDOW:
            self._began, self._before, self._offset = arrived, self._offset, math.inf
        self._offset = min(self._offset, arrived - unwound / 1000)
        return unwound / 1000 + min(self._offset, self._before)
