"""The points used by a search, and the free heights at each."""

from __future__ import annotations

import numpy as np

from star_core import Array, Rows, compiled
from star_visibility.openings import openings
from star_visibility.regions import Regions
from star_visibility.search import Nodes

LEAST = 1e-9  # m; a smaller range of heights counts as empty


def nodes(
    parts: Regions, span: Array, height: tuple[float, float], position: Array, block: Rows
) -> Nodes:
    """Return points and their states.

    Args:
        parts: Blocks.
        span: (G, 2) least and greatest height of each, m.
        height: Lowest and highest flight height z, m.
        position: (P, 2) the points, m.
        block: (P,) block whose corner each point is; -1 for none.
    """
    of, free = columns(parts, span, position, *height)
    come = free.copy()
    own = block[of] >= 0
    its = span[block[of[own]]] if own.any() else np.empty((0, 2))
    come[own, 0] = np.maximum(come[own, 0], its[:, 0])
    come[own, 1] = np.minimum(come[own, 1], its[:, 1])
    use = come[:, 1] - come[:, 0] > LEAST
    of, free, come = of[use], free[use], come[use]
    return Nodes(position, np.searchsorted(of, np.arange(len(position) + 1)), free, come, of)


def joined(some: Nodes, others: Nodes) -> Nodes:
    """Return the points of both tables."""
    count = len(some.position)
    return Nodes(
        np.concatenate([some.position, others.position]),
        np.concatenate([some.first, some.first[-1] + others.first[1:]]),
        np.concatenate([some.open, others.open]),
        np.concatenate([some.come, others.come]),
        np.concatenate([some.of, others.of + count]),
    )


@compiled
def columns(
    parts: Regions, span: Array, position: Array, low: float, high: float
) -> tuple[Rows, Array]:
    """Return the free height ranges at each point: (S,) its row, and (S, 2) the ranges.

    They are in ascending order of rows and heights.
    """
    rows, least, greatest = [0 for _ in range(0)], [0.0 for _ in range(0)], [0.0 for _ in range(0)]
    for i in range(len(position)):
        free = openings(parts, span, position[i], position[i], (low, high), (-1, -1))
        for k in range(len(free)):
            rows.append(i)
            least.append(free[k, 0])
            greatest.append(free[k, 1])
    of, heights = np.empty(len(rows), np.int64), np.empty((len(rows), 2))
    for k in range(len(rows)):
        of[k], heights[k, 0], heights[k, 1] = rows[k], least[k], greatest[k]
    return of, heights
