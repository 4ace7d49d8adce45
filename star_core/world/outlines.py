"""Outlines in the map's x-y plane: of boxes and walls, and why one is not a polygon."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final

from star_core.world.world import Corner

COLLINEAR: Final = 1e-12  # distance from a line over its length, below which points are on it
MIN_WIDTH: Final = 0.001
"""Least width of an outline, m, across the line from its first corner to the farthest, as of walls
in the schema. A thinner one is a typing error."""


def box(centre: Sequence[float], size: Sequence[float], yaw: float) -> tuple[Corner, ...]:
    """Return the corners of a rectangle, anticlockwise.

    Args:
        centre: x and y, m.
        size: Lengths along its own x and y axes, m.
        yaw: Of its x axis in the map, rad, anticlockwise.

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


def wall(
    points: Iterable[Corner], thickness: float, *, flat: bool = False
) -> tuple[tuple[Corner, ...], ...]:
    """Return one rectangle for each stretch of a wall along `points`.

    Each rectangle reaches half a thickness beyond the ends of its stretch, so that corners close.

    Args:
        points: Along the middle of the wall, m.
        thickness: m.
        flat: Whether the wall ends at its first and its last point, if these differ.

    >>> wall([(0, 0), (2, 0)], 0.2)
    (((-0.1, -0.1), (2.1, -0.1), (2.1, 0.1), (-0.1, 0.1)),)
    >>> wall([(0, 0), (2, 0)], 0.2, flat=True)
    (((0.0, -0.1), (2.0, -0.1), (2.0, 0.1), (0.0, 0.1)),)
    """
    line = list(points)
    half = thickness / 2
    flat = flat and line[0] != line[-1]
    pieces = []
    for i, ((ax, ay), (bx, by)) in enumerate(pairwise(line), start=1):
        length = math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / length * half, (by - ay) / length * half  # along the wall
        x, y = (0.0, 0.0) if flat and i == 1 else (ux, uy)
        u, v = (0.0, 0.0) if flat and i == len(line) - 1 else (ux, uy)
        pieces.append(
            (
                (ax - x + uy, ay - y - ux),
                (bx + u + uy, by + v - ux),
                (bx + u - uy, by + v + ux),
                (ax - x - uy, ay - y + ux),
            )
        )
    return tuple(pieces)


def outline_fault(corners: Sequence[Corner]) -> str | None:
    """Return why `corners`, m, are not the outline of a polygon, or None if they are.

    >>> outline_fault([(0, 0), (1, 1), (1, 0), (0, 1)])
    'crosses or touches itself at [0.5, 0.5]'
    """
    if any(a == b for a, b in pairwise([*corners, corners[0]])):
        return "has the same point twice in a row"
    (x, y), (dx, dy) = corners[0], _longest(corners)
    length = math.hypot(dx, dy)
    off = [(dx * (v - y) - dy * (u - x)) / length for u, v in corners]
    if max(map(abs, off)) <= COLLINEAR * length:
        return "has all its points on one line"
    if (strip := max(off) - min(off)) < MIN_WIDTH:
        return f"lies in a strip of only {strip:.2g} m, expected at least {MIN_WIDTH:g} m"
    import shapely  # numpy with it: only a world with polygons needs them

    reason = shapely.is_valid_reason(shapely.Polygon(corners))  # such as "Self-intersection[0.5 1]"
    if "[" in reason:
        where = ", ".join(f"{float(value):g}" for value in reason.split("[")[1][:-1].split())
        return f"crosses or touches itself at [{where}]"
    return None


def _longest(corners: Sequence[Corner]) -> Corner:
    """The vector from the first corner to the farthest one, m."""
    (x, y), (u, v) = corners[0], max(corners, key=lambda corner: math.dist(corners[0], corner))
    return u - x, v - y
