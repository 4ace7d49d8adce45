"""The pace of a simulation: mission time against wall time."""

from __future__ import annotations

import time


class Pace:
    """Slows a simulation down to a speed, which may change at any time."""

    def __init__(self) -> None:
        self._speed: float | None = None
        self._begun = self._last = (0.0, 0.0)  # s: mission time and wall time

    def keep(self, now: float, speed: float | None) -> None:
        """Sleep until mission time `now`, s, is due; do not sleep if `speed` is None."""
        clock = time.monotonic()
        if speed != self._speed:
            self._speed = speed
            self._begun = self._last if self._last[0] else (0.0, clock)
        if speed is not None:
            mission, wall = self._begun
            time.sleep(max(0.0, wall + (now - mission) / speed - clock))
        self._last = now, time.monotonic()
