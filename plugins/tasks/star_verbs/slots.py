"""Where to put several agents that are sent to one place. Nothing here imports numpy."""

from __future__ import annotations

import math
from collections.abc import Sequence

Point = tuple[float, float, float]

# Where the middle of a compact pattern can lie on a hexagonal lattice of unit spacing: on a point,
# midway between two, and amid three.
_MIDDLES = ((0.0, 0.0), (0.5, 0.0), (0.5, math.sqrt(3) / 6))


def slots(n: int, centre: Sequence[float], spacing: float) -> list[Point]:
    """Return `n` places around `centre`, all at its height, none nearer to another than `spacing`.

    The places are the `n` points of a hexagonal lattice that lie nearest to its middle, moved so
    that their mean is `centre`: one agent gets the centre, two a line along x, three a triangle,
    seven a ring around one. Of the lattice's three possible middles the most compact is taken.

    Args:
        n: How many.
        centre: x, y, z, m.
        spacing: Distance between neighbours, m.

    Example:
        >>> slots(2, (1, 0, 0.8), 0.5)
        [(0.75, 0.0, 0.8), (1.25, 0.0, 0.8)]
    """
    _, pattern = min(_compact(n, middle) for middle in _MIDDLES)
    x, y, z = centre
    return [(x + spacing * u, y + spacing * v, float(z)) for u, v in pattern]


def _compact(n: int, middle: tuple[float, float]) -> tuple[float, list[tuple[float, float]]]:
    """The `n` lattice points nearest to `middle` about their mean, after their mean square."""
    reach = math.isqrt(n) + 2  # rows and columns that hold more than n points around the middle
    lattice = (
        (i + j / 2 - middle[0], j * math.sqrt(3) / 2 - middle[1])
        for i in range(-2 * reach, 2 * reach + 1)
        for j in range(-reach, reach + 1)
    )
    # Rounded, so that points at one distance are told apart by their place and not by noise.
    nearest = sorted(lattice, key=lambda p: (round(math.hypot(*p), 6), round(p[1], 6), p[0]))[:n]
    x, y = (math.fsum(values) / n for values in zip(*nearest, strict=True))
    pattern = [(u - x, v - y) for u, v in nearest]
    return round(math.fsum(u * u + v * v for u, v in pattern), 6), pattern
