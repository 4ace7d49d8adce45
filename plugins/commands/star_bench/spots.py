"""Spots for agents: in rows, with jitter, or random and separated.

Only `random.Random.random` is used: it alone is guaranteed to return the same numbers in every
version of Python, so that a scenario's file is the same everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from random import Random
from typing import Final

from star_bench.scenario import GAP, Spot

JITTER: Final = 0.05  # m, greatest displacement of a spot
PITCH: Final = 1.0
"""Distance of neighbours before jitter, m. A third agent can pass between two that have arrived,
each with a radius of 0.2 m: otherwise the last one faces a sliding puzzle."""

TRIES: Final = 2000
"""Number of spots drawn for one agent before the area counts as full."""


def between(rng: Random, low: float, high: float) -> float:
    """Draw a number between two."""
    return low + (high - low) * rng.random()


def shaken(spot: Spot, rng: Random, reach: float = JITTER) -> Spot:
    """Return a spot anywhere in the circle of radius `reach`, m, around another."""
    angle, away = math.tau * rng.random(), reach * math.sqrt(rng.random())
    return spot[0] + away * math.cos(angle), spot[1] + away * math.sin(angle)


def place(index: int, lanes: int) -> tuple[int, float]:
    """Return the row of an agent in rows of `lanes` agents, and its lateral offset, m.

    >>> [place(i, 3) for i in range(4)]
    [(0, -1.0), (0, 0.0), (0, 1.0), (1, -1.0)]
    """
    row, lane = divmod(index, lanes)
    return row, (lane - (lanes - 1) / 2) * PITCH


def shuffled(n: int, rng: Random) -> list[int]:
    """Return the numbers below `n` in random order."""
    keys = [rng.random() for _ in range(n)]
    return sorted(range(n), key=keys.__getitem__)


def scattered(
    n: int, half: float, rng: Random, *, gap: float = GAP, free: Callable[[Spot], bool] = bool
) -> list[Spot] | None:
    """Draw spots that are `free` and separated in a square around the origin.

    Args:
        n: Number of spots.
        half: Half the square's side, m.
        rng: Random number generator.
        gap: Least distance between two spots, m.
        free: Whether a spot may be used; any may if not given.

    Returns:
        The spots, or None if there is no room for so many.
    """
    found: list[Spot] = []
    for _ in range(n):
        for _ in range(TRIES):
            spot = between(rng, -half, half), between(rng, -half, half)
            if free(spot) and apart(spot, found, gap):
                found.append(spot)
                break
        else:
            return None
    return found


def apart(spot: Spot, others: Sequence[Spot], gap: float) -> bool:
    """Whether a spot is at least `gap`, m, from all others."""
    return all(math.dist(spot, other) >= gap for other in others)
