"""Positions for several agents sent to one point. Does not import numpy."""

from __future__ import annotations

import math
from collections.abc import Sequence

Point = tuple[float, float, float]

# Possible centers of a compact pattern on a hexagonal lattice of unit spacing: a point, the
# midpoint of two, and the center of three.
_MIDDLES = ((0.0, 0.0), (0.5, 0.0), (0.5, math.sqrt(3) / 6))


def slots(n: int, centre: Sequence[float], spacing: float) -> list[Point]:
    """Return `n` positions around `centre`, all at its height, at least `spacing` apart.

    They are the `n` points of a hexagonal lattice nearest to its center, moved so that their mean
    is `centre`: one agent gets the center, two a line along x, three a triangle, seven a ring
    around one. Of the lattice's three possible centers the most compact is taken.

    Args:
        n: Number of agents.
        centre: x, y, z, m.
        spacing: Distance between neighbours, m.

    Example:
        >>> slots(2, (1, 0, 0.8), 0.5)
        [(0.75, 0.0, 0.8), (1.25, 0.0, 0.8)]
    """
    _, pattern = min(_compact(n, middle) for middle in _MIDDLES)
    x, y, z = centre
    return [(x + spacing * u, y + spacing * v, float(z)) for u, v in pattern]


def shifted_by(shift: Point, agents: int) -> str:
    """Return the suffix of a message about a point that is shifted for one of several agents.

    >>> shifted_by((0.3, 0.0, 0.0), 2)
    ', shifted by [0.3, 0, 0] for one of 2 agents'
    """
    x, y, z = shift
    if agents == 1 or not any(shift):
        return ""
    return f", shifted by [{x:g}, {y:g}, {z:g}] for one of {agents} agents"


def _compact(n: int, middle: tuple[float, float]) -> tuple[float, list[tuple[float, float]]]:
    """The `n` lattice points nearest to `middle` relative to their mean, and their mean square."""
    reach = math.isqrt(n) + 2  # rows and columns that contain more than n points around the center
    lattice = (
        (i + j / 2 - middle[0], j * math.sqrt(3) / 2 - middle[1])
        for i in range(-2 * reach, 2 * reach + 1)
        for j in range(-reach, reach + 1)
    )
    # Rounded, so that points at equal distances are ordered by their position and not by noise.
    nearest = sorted(lattice, key=lambda p: (round(math.hypot(*p), 6), round(p[1], 6), p[0]))[:n]
    x, y = (math.fsum(values) / n for values in zip(*nearest, strict=True))
    pattern = [(u - x, v - y) for u, v in nearest]
    return round(math.fsum(u * u + v * v for u, v in pattern), 6), pattern
