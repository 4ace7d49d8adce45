"""The heights at which a point, or the segment between two points, is free."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array
from star_core.toolkit import compiled, subroutine
from star_visibility.line_of_sight import LEVEL, meeting, meets, on_outline, within
from star_visibility.regions import Regions


@subroutine
def openings(
    parts: Regions,
    span: Array,
    a: Array,
    b: Array,
    heights: tuple[float, float],
    touches: tuple[int, int],
) -> Array:
    """Return the heights at which the segment from a to b is free: (K, 2) m.

    Each row is a least and a greatest height, in ascending order. Running along an outline is free;
    touching a corner between a and b is not: such a path is two segments. If a is b, it is a point.

    Args:
        parts: Blocks, used as bands.
        span: (G, 2) least and greatest height of each, m.
        a: (2,) m.
        b: (2,) m.
        heights: Least and greatest height to consider, m.
        touches: Blocks that the segment touches at a and at b without entering them there; -1 for
            none.
    """
    low, high = heights
    ax, ay, bx, by = a[0], a[1], b[0], b[1]
    count = len(span)
    begin, end = np.empty(count + 1), np.empty(count + 1)
    crossings = 0
    for part in range(count):
        foot, top = span[part, 0], span[part, 1]
        if foot >= high or top <= low:
            continue
        if meets(parts, part, ax, ay, bx, by) or (
            part not in touches and strictly(parts, part, (ax + bx) / 2, (ay + by) / 2)
        ):
            index = crossings  # in ascending order of their lower bounds
            while index > 0 and begin[index - 1] > foot:
                begin[index], end[index] = begin[index - 1], end[index - 1]
                index -= 1
            begin[index], end[index] = foot, top
            crossings += 1
    begin[crossings] = np.inf
    free = np.empty((crossings + 1, 2))
    rows, least = 0, low
    for k in range(crossings + 1):
        if min(begin[k], high) - least > LEVEL:
            free[rows, 0], free[rows, 1] = least, min(begin[k], high)
            rows += 1
        if k < crossings:
            least = max(least, end[k])
    answer: Array = free[:rows]
    return answer


@subroutine
def strictly(parts: Regions, part: int, x: float, y: float) -> bool:
    """Whether a point is inside a block, and not on its outline within rounding."""
    return within(parts, part, x, y) and not on_outline(parts, part, x, y)


@compiled
def entered(parts: Regions, part: int, ax: float, ay: float, bx: float, by: float) -> Array:
    """Return the interval of distances from a in which the segment to b is in a block: (2,) m.

    Gaps between several crossings count as inside; the interval begins at infinity if there is
    none.
    """
    length = math.hypot(bx - ax, by - ay)
    answer = np.array([np.inf, np.inf])
    first = meeting(parts, part, ax, ay, bx, by, False)  # noqa: FBT003
    if first == np.inf:
        if strictly(parts, part, (ax + bx) / 2, (ay + by) / 2):
            answer[0], answer[1] = 0.0, length
        return answer
    last = length - meeting(parts, part, bx, by, ax, ay, False)  # noqa: FBT003
    ux, uy = (bx - ax) / length, (by - ay) / length
    answer[0], answer[1] = first, last
    if strictly(parts, part, ax + ux * first / 2, ay + uy * first / 2):
        answer[0] = 0.0
    middle = (last + length) / 2
    if strictly(parts, part, ax + ux * middle, ay + uy * middle):
        answer[1] = length
    return answer
