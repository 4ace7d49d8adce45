"""The visibility graph of one band: corners, and the tangents between those that see each other."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from star_core import Array, Fence, Rows, compiled
from star_visibility.sight import TOUCH, meets
from star_visibility.walls import Walls


class Graph(NamedTuple):
    """Corners that a shortest path can turn at, and the stretches between them.

    Attributes:
        corner: (C, 2) m.
        before: (C, 2) corner before it on its outline, m.
        after: (C, 2) corner after it, m.
        first: (C + 1,) first stretch of each corner, and one past the last.
        to: (S,) corner that a stretch leads to.
        length: (S,) m.
    """

    corner: Array
    before: Array
    after: Array
    first: Rows
    to: Rows
    length: Array


def graph(walls: Walls, band: int, fence: Fence) -> Graph:
    """Return the reduced visibility graph of a band.

    A shortest path among polygons turns at corners where they are convex only, and touches them
    there without cutting in (Lozano-Pérez and Wesley, CACM 22(10), 1979): other corners and
    stretches are left out. So are corners outside the fence, which is convex: no path turns there.
    """
    corners, befores, afters = [np.empty((0, 2))], [np.empty((0, 2))], [np.empty((0, 2))]
    for ring in range(walls.first_ring[band], walls.first_ring[band + 1]):
        corner = walls.corner[walls.first_corner[ring] : walls.first_corner[ring + 1]]
        before, after = np.roll(corner, 1, axis=0), np.roll(corner, -1, axis=0)
        come, go = corner - before, after - corner
        convex = come[:, 0] * go[:, 1] - come[:, 1] * go[:, 0] > -TOUCH
        convex &= ((corner >= fence.low[:2]) & (corner <= fence.high[:2])).all(axis=1)
        corners.append(corner[convex])
        befores.append(before[convex])
        afters.append(after[convex])
    corner, before, after = map(np.concatenate, (corners, befores, afters))
    return Graph(corner, before, after, *connect(walls, band, corner, before, after))


@compiled
def connect(
    walls: Walls, band: int, corner: Array, before: Array, after: Array
) -> tuple[Rows, Rows, Array]:
    """Return the last three fields of a `Graph`."""
    n = len(corner)
    count = np.zeros(n + 1, np.int64)
    one, other = [0 for _ in range(0)], [0 for _ in range(0)]
    for i in range(n):
        for j in range(i):
            if (
                passes(corner[j], corner[i], before[i], after[i])
                and passes(corner[i], corner[j], before[j], after[j])
                and math.hypot(corner[i, 0] - corner[j, 0], corner[i, 1] - corner[j, 1]) > TOUCH
                and not meets(walls, band, corner[i, 0], corner[i, 1], corner[j, 0], corner[j, 1])
            ):
                one.append(i)
                other.append(j)
                count[i + 1] += 1
                count[j + 1] += 1
    for i in range(n):
        count[i + 1] += count[i]
    first, place = count, count.copy()
    to = np.empty(2 * len(one), np.int64)
    length = np.empty(2 * len(one))
    for k in range(len(one)):
        i, j = one[k], other[k]
        distance = math.hypot(corner[i, 0] - corner[j, 0], corner[i, 1] - corner[j, 1])
        to[place[i]], to[place[j]] = j, i
        length[place[i]] = length[place[j]] = distance
        place[i] += 1
        place[j] += 1
    return first, to, length


@compiled
def passes(point: Array, corner: Array, before: Array, after: Array) -> bool:
    """Whether the line from a point through a convex corner leaves its outline on one side."""
    ux, uy = corner[0] - point[0], corner[1] - point[1]
    near = TOUCH * (abs(ux) + abs(uy))
    one = ux * (before[1] - corner[1]) - uy * (before[0] - corner[0])
    other = ux * (after[1] - corner[1]) - uy * (after[0] - corner[0])
    return bool((one >= -near and other >= -near) or (one <= near and other <= near))


@compiled
def seen_from(
    walls: Walls, band: int, corner: Array, before: Array, after: Array, point: Array
) -> Array:
    """Return how far each corner is from a free point, (C,) m; infinity where no tangent leads."""
    distance = np.full(len(corner), np.inf)
    for i in range(len(corner)):
        if passes(point, corner[i], before[i], after[i]) and not meets(
            walls, band, point[0], point[1], corner[i, 0], corner[i, 1]
        ):
            distance[i] = math.hypot(corner[i, 0] - point[0], corner[i, 1] - point[1])
    return distance
