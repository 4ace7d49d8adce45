"""Round-trip time of a link, and the retry timeout derived from it."""

from __future__ import annotations

from typing import Final

MARGIN: Final = 0.05  # s above the mean, at least: reports and other packets delay answers


class RoundTrip:
    """Mean and mean deviation of round-trip times, smoothed as TCP does (RFC 6298, section 2)."""

    def __init__(self) -> None:
        self._mean: float | None = None  # s
        self._deviation = 0.0  # s

    def note(self, time: float) -> None:
        """Add a measured round-trip time, s."""
        if self._mean is None:
            self._mean, self._deviation = time, time / 2
            return
        self._deviation += (abs(time - self._mean) - self._deviation) / 4
        self._mean += (time - self._mean) / 8

    @property
    def timeout(self) -> float:
        """Time after which an answer counts as lost, s; 0 before the first measurement.

        >>> trip = RoundTrip()
        >>> trip.note(0.3)
        >>> round(trip.timeout, 9)
        0.9
        """
        return 0.0 if self._mean is None else self._mean + max(MARGIN, 4 * self._deviation)
