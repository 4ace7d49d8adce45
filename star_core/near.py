"""Which agents are near each other."""

from __future__ import annotations

from functools import cache

import numpy as np

from star_core.table import Array, Rows

MANY = 64
"""Agents from which on neighbours are found by a tree; below, by all pairs."""


def pairs(position: Array, reach: float) -> tuple[Rows, Rows]:
    """Return the rows of every two agents that are nearer than `reach` to each other, m.

    Their order is the same for the same positions; it costs more to sort than to find them.

    Agents that are nowhere (NaN) are near nobody.

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
    from scipy.spatial import cKDTree

    rows = np.flatnonzero(np.isfinite(position).all(axis=1))
    tree = cKDTree(position[rows])
    found = tree.query_pairs(np.nextafter(reach, 0.0), output_type="ndarray")
    return rows[found[:, 0]], rows[found[:, 1]]


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
