"""Viewpoints of scouts: what they see from there, and how far it is."""

from __future__ import annotations

import math
from itertools import product
from typing import Final

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from star_core import Array, Rows
from star_search.field_of_view import FieldOfView
from star_search.search_space import SearchSpace

SPACING: Final = 2  # cells between neighbouring positions
HEADINGS: Final = 8


class Viewpoints:
    """All positions of a lattice from which the area can be seen, with some headings each.

    Paths lead from each position to its eight neighbours.

    Args:
        space: Where to search.
        view: What the scouts see reliably.

    Attributes:
        pose: (V, 3) x, y and yaw, map frame, m and rad.
        cells: (V, M) cells of the coverage map that are seen from each, or its `outside`.
        node: (V,) row in the lattice.
    """

    def __init__(self, space: SearchSpace, view: FieldOfView) -> None:
        self._position, self._links = _lattice(space)
        yaw = np.arange(HEADINGS) * math.tau / HEADINGS
        near = shapely.dwithin(space.area, shapely.points(self._position), view.reach)
        at = np.flatnonzero(near)
        node: Rows = np.repeat(at, HEADINGS)
        pose: Array = np.column_stack([self._position[node], np.tile(yaw, len(at))])
        cells = space.coverage.visible(view, pose)
        useful = space.coverage.required[cells].any(axis=1)
        self.pose, self.cells, self.node = pose[useful], cells[useful], node[useful]

    def distance(self, position: Array) -> Array:
        """(V,) length of the path from a position to each viewpoint, m; inf if there is none."""
        if not len(self._position):
            return np.zeros(0)
        start = int(np.argmin(((self._position - position[:2]) ** 2).sum(axis=1)))
        lengths: Array = dijkstra(self._links, directed=False, indices=np.array([start]))
        length: Array = lengths[0, self.node]
        return length


def _lattice(space: SearchSpace) -> tuple[Array, csr_array]:
    """Positions where an agent may be, (P, 2), m, and the distances between neighbours."""
    step = SPACING * space.coverage.cell
    if not space.regions:
        return np.zeros((0, 2)), csr_array((0, 0))
    west, south, east, north = shapely.total_bounds(space.regions)
    x, y = np.arange(west, east, step) + 1e-6, np.arange(south, north, step) + 1e-6
    free = np.zeros((len(x) + 2, len(y) + 2), np.bool_)  # with a border that is not free
    for region in space.regions:
        shapely.prepare(region)
        free[1:-1, 1:-1] |= shapely.contains_xy(region, *np.meshgrid(x, y, indexing="ij"))
    number = np.cumsum(free).reshape(free.shape) - 1
    i, j = np.nonzero(free)
    begins, ends, lengths = [], [], []
    for di, dj in product((0, 1), (-1, 0, 1)):
        if (di, dj) in {(0, 0), (0, -1)}:
            continue
        there = free[i + di, j + dj]
        begins.append(number[i, j][there])
        ends.append(number[i + di, j + dj][there])
        lengths.append(np.full(there.sum(), step * math.hypot(di, dj)))
    links = csr_array(
        (np.concatenate(lengths), (np.concatenate(begins), np.concatenate(ends))),
        shape=(len(i), len(i)),
    )
    return np.column_stack([x[i - 1], y[j - 1]]), links
