"""Pairs of agents that are close to each other."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from star_core.messages.arrays import Array, Rows
from star_core.toolkit.jit import compiled

MANY = 64
"""Agents from which on neighbours are found in the order of x, by a kernel; below, by all pairs."""


def pairs(position: Array, reach: float) -> tuple[Rows, Rows]:
    """Return the rows of every two agents that are nearer than `reach` to each other, m.

    The order is the same for the same positions. Agents without a position (NaN) are left out.

    Args:
        position: (N, 3) m.
        reach: m.

    Returns:
        (P,) and (P,) rows, the smaller one of a pair in the first.

    Example:
        >>> first, second = pairs(np.array([[0.0, 0, 0], [5, 0, 0], [0, 1, 0]]), 2.0)
        >>> first.tolist(), second.tolist()
        ([0], [2])
    """
    if len(position) < MANY:
        first, second = _every_pair(len(position))
        near = np.flatnonzero(_apart(position, first, second) < reach)  # what is NaN is not
        return first.take(near), second.take(near)
    order = np.argsort(position[:, 0])
    found = _swept(np.ascontiguousarray(position[order]), float(reach))
    one, other = order[found[0]], order[found[1]]
    return np.minimum(one, other), np.maximum(one, other)


def warm_up() -> None:
    """Compile what `pairs` takes for many, or fetch it from disk: never in flight."""
    pairs(np.zeros((MANY, 3)), 0.0)


def least(position: Array) -> float:
    """Return how near two agents are to each other at least, m; infinite if there are no two.

    Args:
        position: (N, 3) m.

    Example:
        >>> least(np.array([[0.0, 0, 0], [5, 0, 0], [0, 1, 0]]))
        1.0
    """
    known = position[np.isfinite(position).all(axis=1)]
    if len(known) < 2:  # noqa: PLR2004 -- a pair
        return np.inf
    if len(known) < MANY:
        return float(_apart(known, *_every_pair(len(known))).min())
    from scipy.spatial import cKDTree

    reach: Array = np.asarray(cKDTree(known).query(known, k=2)[0])  # (N, 2), itself the first
    return float(reach[:, 1].min())


@compiled
def _swept(position: Array, reach: float) -> Rows:
    """Return (2, P) rows of those nearer than `reach`, m; (N, 3) m stand in the order of x."""
    n, count = len(position), 0
    rows = np.empty((2, 4 * n), np.int64)
    for i in range(n):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        for j in range(i + 1, n):
            ahead = position[j, 0] - x
            if not ahead < reach:  # what is NaN is not, and stands last
                break
            aside, above = position[j, 1] - y, position[j, 2] - z
            if not -reach < aside < reach:
                continue
            if math.sqrt(ahead * ahead + aside * aside + above * above) < reach:
                if count == rows.shape[1]:
                    more = np.empty((2, 2 * count), np.int64)
                    more[:, :count] = rows
                    rows = more
                rows[0, count], rows[1, count] = i, j
                count += 1
    return rows[:, :count]


def _apart(position: Array, first: Rows, second: Rows) -> Array:
    with np.errstate(invalid="ignore"):  # from infinite to infinite
        offset = position.take(first, 0) - position.take(second, 0)
    apart: Array = np.sqrt(np.vecdot(offset, offset))
    return apart


@cache
def _every_pair(n: int) -> tuple[Rows, Rows]:
    """Every two of `n` rows, as two columns."""
    first, second = np.triu_indices(n, 1)
    return first, second
