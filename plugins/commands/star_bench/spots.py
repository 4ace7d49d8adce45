"""Spots for agents: in rows, shaken a little, or drawn anywhere and apart.

`random.Random.random` is all that is drawn from: it alone is promised to give the same numbers in
every version of Python, so that a scenario's file is the same everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from random import Random
from typing import Final

from star_bench.scenario import GAP, Spot

JITTER: Final = 0.05  # m, how far a spot is shaken at most
PITCH: Final = 1.0
"""Distance of neighbours before they are shaken, m. Between two that have arrived a third can pass,
each keeping a radius of 0.2 m for itself: else who comes last has a puzzle of sliding pieces."""

TRIES: Final = 2000
"""Spots that are drawn for one agent before there counts to be no room."""


def between(rng: Random, low: float, high: float) -> float:
    """Draw a number between two."""
    return low + (high - low) * rng.random()


def shaken(spot: Spot, rng: Random, reach: float = JITTER) -> Spot:
    """Return a spot anywhere in the circle of radius `reach`, m, around another."""
    angle, away = math.tau * rng.random(), reach * math.sqrt(rng.random())
    return spot[0] + away * math.cos(angle), spot[1] + away * math.sin(angle)


def place(index: int, lanes: int) -> tuple[int, float]:
    """Return the row of one of some agents that stand in rows of `lanes`, and how far aside, m.

    >>> [place(i, 3) for i in range(4)]
    [(0, -1.0), (0, 0.0), (0, 1.0), (1, -1.0)]
    """
    row, lane = divmod(index, lanes)
    return row, (lane - (lanes - 1) / 2) * PITCH


def shuffled(n: int, rng: Random) -> list[int]:
    """Return the numbers below `n` in an order that is drawn."""
    keys = [rng.random() for _ in range(n)]
    return sorted(range(n), key=keys.__getitem__)


def scattered(
    n: int, half: float, rng: Random, *, gap: float = GAP, free: Callable[[Spot], bool] = bool
) -> list[Spot] | None:
    """Draw spots that are `free` and apart in a square around the origin.

    Args:
        n: How many.
        half: Half the square's side, m.
        rng: What is drawn from.
        gap: Least distance of any two, m.
        free: Whether there may be anything at a spot; anywhere if not given.

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
