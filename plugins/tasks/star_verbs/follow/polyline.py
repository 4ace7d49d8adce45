"""Polylines, measured along their length. Does not import numpy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

Point = tuple[float, float, float]


def length(points: Sequence[Point]) -> float:
    """Length of the line through `points`, in their unit.

    >>> length([(0, 0, 0), (3, 4, 0), (3, 4, 2)])
    7.0
    """
    return math.fsum(math.dist(a, b) for a, b in itertools.pairwise(points))


def evenly(points: Sequence[Point], count: int) -> list[Point]:
    """Return `count` points at equal distances along the line, from its start, excluding its end.

    >>> evenly([(0, 0, 0), (1, 0, 0), (1, 1, 0)], 4)
    [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.5, 0.0)]
    """
    step = length(points) / count
    found: list[Point] = []
    passed = 0.0
    for a, b in itertools.pairwise(points):
        stretch = math.dist(a, b)
        while len(found) < count and len(found) * step < passed + stretch:
            found.append(between(a, b, (len(found) * step - passed) / stretch))
        passed += stretch
    return found


def dense(a: Point, b: Point, step: float) -> Iterator[Point]:
    """Yield points from `a` to `b`, both included, no more than `step` apart.

    >>> [x for x, _, _ in dense((0, 0, 0), (1, 0, 0), 0.5)]
    [0.0, 0.5, 1.0]
    """
    pieces = max(1, math.ceil(math.dist(a, b) / step))
    for piece in range(pieces + 1):
        yield between(a, b, piece / pieces)


def between(a: Point, b: Point, part: float) -> Point:
    """The point at the fraction `part` (0 to 1) of the segment from `a` to `b`.

    >>> between((0, 0, 0), (2, 0, 4), 0.25)
    (0.5, 0.0, 1.0)
    """
    x, y, z = (p + part * (q - p) for p, q in zip(a, b, strict=True))
    return x, y, z
