"""Turns the time stamps of a Crazyflie into times of the computer's own clock."""

from __future__ import annotations

import math
from typing import Final

TURNS_AT: Final = 1 << 24  # ms: stamps have 24 bits, which last for 4.7 h
WINDOW: Final = 2.0  # s: 20 reports of the slowest; one that fell behind is followed within two
RESTARTED: Final = 1000  # ms by which a stamp is behind the last: late packets are not that late


class Clock:
    """Estimates the offset of a drone's clock as the least that a report ever took to arrive.

    A report is never early: arrival less stamp is the offset plus a delay, and the least of it is
    nearest to the offset (as in Cristian, Distributed Computing 3, 1989). Only the present and the
    last `WINDOW` count, so that the offset follows a drift of the clocks, 40 ppm of which are
    0.2 ms in two of them, and a simulated drone that could not keep up with real time. What is left
    over is the quickest way over the link, some milliseconds, by which times are late.
    """

    def __init__(self) -> None:
        self._last: int | None = None  # ms, of the newest stamp, not turned over
        self._began = 0.0  # s, of the present window
        self._offset = self._before = math.inf  # s, of the present and of the last window

    def time(self, stamp: int, arrived: float) -> float:
        """Return when a report was made, s of the computer's clock, never after it arrived.

        Args:
            stamp: What the report says, ms since the drone was started, of 24 bits.
            arrived: When it was here, s.
        """
        last = stamp if self._last is None else self._last
        step = (stamp - last + TURNS_AT // 2) % TURNS_AT - TURNS_AT // 2
        if self._last is None or step < -RESTARTED:
            last, step = stamp, 0
            self._last, self._began = stamp, arrived
            self._offset = self._before = math.inf
        unwound = last + step
        self._last = max(last, unwound)
        if arrived - self._began > WINDOW:
            self._began, self._before, self._offset = arrived, self._offset, math.inf
        self._offset = min(self._offset, arrived - unwound / 1000)
        return unwound / 1000 + min(self._offset, self._before)
