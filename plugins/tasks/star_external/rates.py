"""Rate of state lines and of calls to a planner. Does not import numpy."""

from __future__ import annotations


def ticks_between(rate: float | None, period: float) -> int:
    """Return the number of ticks between two state lines, or two calls to a planner.

    Args:
        rate: Wanted rate, 1/s; None for every tick.
        period: Duration of a tick, s.

    Example:
        >>> ticks_between(10, 0.05), ticks_between(None, 0.05), ticks_between(1000, 0.05)
        (2, 1, 1)
    """
    return 1 if rate is None else max(1, round(1 / (rate * period)))
