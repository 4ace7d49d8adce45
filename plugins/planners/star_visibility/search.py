"""The shortest way through a visibility graph."""

from __future__ import annotations

import math
from heapq import heappop, heappush

import numpy as np

from star_core import Array, Rows, compiled


@compiled
def shortest(  # noqa: C901 -- one search is one loop
    corner: Array, first: Rows, to: Rows, length: Array, start: Array, goal: Array, at: Array
) -> Rows:
    """Return the corners that the shortest way turns at, in order; none if there is no way.

    This is A* (Hart, Nilsson and Raphael, IEEE SSC 4(2), 1968) with the straight distance to the
    goal as its estimate, which never is too long.

    Args:
        corner: (C, 2) m.
        first: (C + 1,) first stretch of each corner, and one past the last.
        to: (S,) corner that a stretch leads to.
        length: (S,) of each stretch, m.
        start: (C,) from the start to each corner, m; infinity where it cannot be seen.
        goal: (C,) from each corner to the goal, m; infinity where it cannot be seen.
        at: (2,) goal, m.
    """
    n = len(corner)
    passed = np.full(n + 1, np.inf)  # row n is the goal
    came = np.full(n + 1, -1)
    queue = [(np.inf, 0)]
    for i in range(n):
        if start[i] < np.inf:
            passed[i] = start[i]
            heappush(queue, (start[i] + math.hypot(corner[i, 0] - at[0], corner[i, 1] - at[1]), i))
    done = np.zeros(n + 1, np.bool_)
    while True:
        total, i = heappop(queue)
        if total == np.inf or i == n:
            break
        if done[i]:
            continue
        done[i] = True
        if passed[i] + goal[i] < passed[n]:
            passed[n] = passed[i] + goal[i]
            came[n] = i
            heappush(queue, (passed[n], n))
        for k in range(first[i], first[i + 1]):
            j = to[k]
            way = passed[i] + length[k]
            if way < passed[j]:
                passed[j] = way
                came[j] = i
                rest = math.hypot(corner[j, 0] - at[0], corner[j, 1] - at[1])
                heappush(queue, (way + rest, j))
    count, i = 0, came[n]
    while i >= 0:
        count, i = count + 1, came[i]
    way_points = np.empty(count, np.int64)
    i = came[n]
    while i >= 0:
        count -= 1
        way_points[count] = i
        i = came[i]
    return way_points
