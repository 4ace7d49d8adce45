"""How long an action may take before it counts as failed. Nothing here imports numpy."""

from __future__ import annotations

from typing import Final

FACTOR: Final = 3.0  # agents brake, make way for each other and wait for each other
GRACE: Final = 5.0  # s: spin up, settle, and be detected as landed


def timeout(expected: float, grace: float = GRACE) -> float:
    """Return the timeout of an action that takes `expected` seconds if nothing delays it, s.

    It is ``FACTOR * expected + grace``. A climb or a descent is expected to take its duration, a
    flight the longest distance of its agents over their speed, a hold its time besides.

    >>> timeout(10.0)
    35.0
    """
    return FACTOR * expected + grace


def step_timeout(derived: float, wait: float | None = None, given: float | None = None) -> float:
    """Return the timeout of a step, s.

    Args:
        derived: What its task returned, s.
        wait: For how long the condition that ends the step waits, s; None without one.
        given: What the mission says, which takes precedence, s.

    Example:
        >>> step_timeout(35.0), step_timeout(35.0, wait=60.0), step_timeout(35.0, given=10.0)
        (35.0, 65.0, 10.0)
    """
    if given is not None:
        return given
    return derived if wait is None else max(derived, wait + GRACE)
