"""The visibility graph of blocks: their corners, and the tangents between them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from star_core import Array, Fence, Rows
from star_core.toolkit import compiled, subroutine
from star_visibility.line_of_sight import TOUCH
from star_visibility.openings import openings
from star_visibility.regions import Regions


class Corners(NamedTuple):
    """Corners at which a shortest path can turn.

    Attributes:
        position: (C, 2) m.
        before: (C, 2) previous corner on its outline, m.
        after: (C, 2) next corner, m.
        block: (C,) block that it belongs to.
    """

    position: Array
    before: Array
    after: Array
    block: Rows


class Graph(NamedTuple):
    """Segments between corners; one that is free in several height ranges is stored several times.

    Attributes:
        first: (C + 1,) first segment of each corner, and one past the last.
        to: (S,) corner that a segment leads to.
        open: (S, 2) least and greatest height at which it is free, m.
    """

    first: Rows
    to: Rows
    open: Array


def corners(parts: Regions, fence: Fence) -> Corners:
    """Return the corners of all blocks at which paths turn.

    A shortest path among polygons turns only where they are convex (Lozano-Pérez and Wesley, CACM
    22(10), 1979): other corners are omitted. So are those outside the fence, which is convex.
    """
    outlines = [(np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 2)), np.empty(0, np.int64))]
    for part in range(len(parts.first_ring) - 1):
        for ring in range(parts.first_ring[part], parts.first_ring[part + 1]):
            corner = parts.corner[parts.first_corner[ring] : parts.first_corner[ring + 1]]
            before, after = np.roll(corner, 1, axis=0), np.roll(corner, -1, axis=0)
            come, go = corner - before, after - corner
            convex = come[:, 0] * go[:, 1] - come[:, 1] * go[:, 0] > -TOUCH
            convex &= ((corner >= fence.low[:2]) & (corner <= fence.high[:2])).all(axis=1)
            outlines.append(
                (corner[convex], before[convex], after[convex], np.full(convex.sum(), part))
            )
    return Corners(*map(np.concatenate, zip(*outlines, strict=True)))


@compiled
def graph(parts: Regions, span: Array, corner: Corners) -> Graph:
    """Return the reduced visibility graph of blocks.

    A shortest path touches a block at a corner without cutting it, and only at heights at which the
    block is there: other segments are omitted.

    Args:
        parts: The blocks.
        span: (G, 2) least and greatest height of each, m.
        corner: Their corners.
    """
    n = len(corner.position)
    count = np.zeros(n + 1, np.int64)
    begin, end = [0 for _ in range(0)], [0 for _ in range(0)]
    least, greatest = [0.0 for _ in range(0)], [0.0 for _ in range(0)]
    for i in range(n):
        a, block = corner.position[i], corner.block[i]
        for j in range(i):
            b, other_block = corner.position[j], corner.block[j]
            if (
                passes(b, a, corner.before[i], corner.after[i])
                and passes(a, b, corner.before[j], corner.after[j])
                and math.hypot(a[0] - b[0], a[1] - b[1]) > TOUCH
            ):
                low, high = (
                    max(span[block, 0], span[other_block, 0]),
                    min(span[block, 1], span[other_block, 1]),
                )
                if low < high:
                    free = openings(parts, span, a, b, (low, high), (block, other_block))
                    for k in range(len(free)):
                        begin.append(i)
                        end.append(j)
                        least.append(free[k, 0])
                        greatest.append(free[k, 1])
                        count[i + 1] += 1
                        count[j + 1] += 1
    for i in range(n):
        count[i + 1] += count[i]
    first, slot = count, count.copy()
    to, heights = np.empty(2 * len(begin), np.int64), np.empty((2 * len(begin), 2))
    for k in range(len(begin)):
        for i, j in ((begin[k], end[k]), (end[k], begin[k])):
            to[slot[i]] = j
            heights[slot[i], 0], heights[slot[i], 1] = least[k], greatest[k]
            slot[i] += 1
    return Graph(first, to, heights)


@subroutine
def passes(point: Array, corner: Array, before: Array, after: Array) -> bool:
    """Whether the line from a point through a convex corner leaves its outline on one side."""
    ux, uy = corner[0] - point[0], corner[1] - point[1]
    near = TOUCH * (abs(ux) + abs(uy))
    side_before = ux * (before[1] - corner[1]) - uy * (before[0] - corner[0])
    side_after = ux * (after[1] - corner[1]) - uy * (after[0] - corner[0])
    return bool(
        (side_before >= -near and side_after >= -near)
        or (side_before <= near and side_after <= near)
    )
