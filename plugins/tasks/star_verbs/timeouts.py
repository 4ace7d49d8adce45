"""How long a verb may take before it counts as failed, if the mission does not say.

Every verb knows how long it takes if nothing is in the way: a climb or a descent its duration, a
flight the longest way of its agents over their speed, a hold its time besides. It may take
`PATIENCE` times that and `GRACE` more.
"""

from __future__ import annotations

PATIENCE = 3.0  # agents brake, make way for each other and wait for each other
GRACE = 5.0  # s: spin up, settle, and be seen to have landed


def time_out(expected: float) -> float:
    """Return the time-out of what should take `expected` seconds, s.

    >>> time_out(10.0)
    35.0
    """
    return PATIENCE * expected + GRACE
