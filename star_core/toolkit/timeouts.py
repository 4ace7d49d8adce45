"""Timeouts of actions and steps. Nothing here imports numpy."""

from __future__ import annotations

from typing import Final

FACTOR: Final = 3.0  # agents brake for each other, move aside and wait
GRACE: Final = 5.0  # s, to spin up, settle, and be detected as landed


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
        derived: Of its task, s.
        wait: Longest time in the condition that ends the step, s; None without one.
        given: ``timeout`` in the mission, which overrides it, s.

    Example:
        >>> step_timeout(35.0), step_timeout(35.0, wait=60.0), step_timeout(35.0, given=10.0)
        (35.0, 65.0, 10.0)
    """
    if given is not None:
        return given
    return derived if wait is None else max(derived, wait + GRACE)
