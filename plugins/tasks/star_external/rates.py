"""How often state lines are sent, or a planner is asked. Nothing here imports numpy."""

from __future__ import annotations


def ticks_between(rate: float | None, period: float) -> int:
    """Return how many ticks there are from one state line, or question, to the next.

    Args:
        rate: How many a second are wanted, 1/s; None for one a tick.
        period: From one tick to the next, s.

    Example:
        >>> ticks_between(10, 0.05), ticks_between(None, 0.05), ticks_between(1000, 0.05)
        (2, 1, 1)
    """
    return 1 if rate is None else max(1, round(1 / (rate * period)))
