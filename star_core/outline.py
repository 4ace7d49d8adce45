"""Outlines in the map's x-y plane: of boxes and cylinders, and what makes one no polygon.

Nothing here imports numpy, so that ``star check`` stays quick.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, TypeAlias

from star_core.world import Corner

SIDES: Final = 24
"""Sides of the polygon around a cylinder; its corners are 0.9 % farther out than the circle."""

FLAT: Final = 1e-12
"""Points off a line by less than this share of its length are on it."""

THIN: Final = 0.001
"""Least width of a strip that an outline fills, m, across the line from its first corner to the
farthest; of walls the schema says the same. What is thinner is a slip of the pen."""

Edge: TypeAlias = tuple[Corner, Corner]


def box(centre: Sequence[float], size: Sequence[float], yaw: float) -> tuple[Corner, ...]:
    """Return the corners of a rectangle, anticlockwise.

    Args:
        centre: x and y of its middle, m.
        size: Its length along its own x axis and along its own y axis, m.
        yaw: How far its x axis is turned from the map's, rad, anticlockwise.

    Example:
        >>> box((1, 1), (2, 1), 0.0)
        ((0.0, 0.5), (2.0, 0.5), (2.0, 1.5), (0.0, 1.5))
    """
    x, y = centre
    cos, sin = math.cos(yaw), math.sin(yaw)
    half, side = size[0] / 2, size[1] / 2
    return tuple(
        (x + cos * a - sin * b, y + sin * a + cos * b)
        for a, b in ((-half, -side), (half, -side), (half, side), (-half, side))
    )


def around_circle(centre: Sequence[float], radius: float) -> tuple[Corner, ...]:
    """Return the corners of a regular polygon of `SIDES` whose sides touch a circle from outside.

    So nothing of a cylinder is left out of its polygon.

    Args:
        centre: x and y, m.
        radius: Of the circle, m.
    """
    x, y = centre
    reach = radius / math.cos(math.pi / SIDES)
    angles = (math.tau * i / SIDES for i in range(SIDES))
    return tuple((x + reach * math.cos(angle), y + reach * math.sin(angle)) for angle in angles)


def outline_fault(corners: Sequence[Corner]) -> str | None:
    """Say why `corners`, m, go round nothing or round no one thing, or return None if they do.

    >>> outline_fault([(0, 0), (1, 1), (1, 0), (0, 1)])
    'crosses or touches itself: the edges from [0, 0] to [1, 1] and from [1, 0] to [0, 1] meet'
    """
    edges = list(pairwise([*corners, corners[0]]))
    if any(a == b for a, b in edges):
        return "has the same point twice in a row"
    end = max(corners, key=lambda corner: math.dist(corners[0], corner))
    length = math.dist(corners[0], end)
    if all(abs(_cross(corners[0], end, corner)) <= FLAT * length * length for corner in corners):
        return "has all its points on one line"
    off = [_cross(corners[0], end, corner) / length for corner in corners]
    if max(off) - min(off) < THIN:
        strip = max(off) - min(off)
        return f"lies in a strip of only {strip:.2g} m, expected at least {THIN:g} m"
    for (a, b), (c, d) in _meetings(edges):
        return (
            f"crosses or touches itself: the edges from {_show(a)} to {_show(b)} "
            f"and from {_show(c)} to {_show(d)} meet"
        )
    return None


def _meetings(edges: Sequence[Edge]) -> Iterator[tuple[Edge, Edge]]:
    """Yield pairs of edges that meet elsewhere than where the one ends and the other begins."""
    order = sorted(range(len(edges)), key=lambda i: min(edges[i][0][0], edges[i][1][0]))
    for place, i in enumerate(order):
        right = max(edges[i][0][0], edges[i][1][0])
        for j in order[place + 1 :]:
            if min(edges[j][0][0], edges[j][1][0]) > right:
                break
            first, second = min(i, j), max(i, j)
            if second - first in {1, len(edges) - 1}:
                before, after = (first, second) if second - first == 1 else (second, first)
                if _turns_back(*edges[before], edges[after][1]):
                    yield edges[first], edges[second]
            elif _meet(*edges[i], *edges[j]):
                yield edges[first], edges[second]


def _turns_back(a: Corner, b: Corner, c: Corner) -> bool:
    """Whether the way on from `b` to `c` runs back along that from `a`."""
    along = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1])
    return _side(a, b, c) == 0 and along < 0


def _meet(a: Corner, b: Corner, c: Corner, d: Corner) -> bool:
    """Whether two stretches, ends included, have a point in common."""
    for axis in (0, 1):
        if max(a[axis], b[axis]) < min(c[axis], d[axis]):
            return False
        if max(c[axis], d[axis]) < min(a[axis], b[axis]):
            return False
    return _side(a, b, c) * _side(a, b, d) <= 0 and _side(c, d, a) * _side(c, d, b) <= 0


def _side(a: Corner, b: Corner, point: Corner) -> int:
    """1 if `point` is left of the line from `a` to `b`, -1 if right, 0 if on it."""
    cross = _cross(a, b, point)
    return (cross > 0) - (cross < 0)


def _cross(a: Corner, b: Corner, point: Corner) -> float:
    """Twice the area of a triangle, less than 0 if it turns clockwise, m²."""
    return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])


def _show(corner: Corner) -> str:
    return f"[{corner[0]:g}, {corner[1]:g}]"
