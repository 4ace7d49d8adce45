"""Where scouts can look from, what they see from there, and how far it is."""

from __future__ import annotations

import math
from itertools import product
from typing import Final

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from star_core import Array, Rows
from star_search.field import Field
from star_search.view import View

SPACING: Final = 2  # cells from one place to the next
HEADINGS: Final = 8


class Viewpoints:
    """Every place on a lattice from where the area can be seen, with some headings each.

    Ways lead from each place to its eight neighbours.

    Args:
        field: Where to search.
        outlook: What the scouts are sure to see.

    Attributes:
        pose: (V, 3) x, y and yaw, map frame, m and rad.
        cells: (V, M) cells of the field's chart that are seen from each, or its `nowhere`.
        place: (V,) row in the lattice.
    """

    def __init__(self, field: Field, outlook: View) -> None:
        self._spot, links = _lattice(field)
        yaw = np.arange(HEADINGS) * math.tau / HEADINGS
        near = shapely.dwithin(field.area, shapely.points(self._spot), outlook.reach)
        at = np.flatnonzero(near)
        self.place: Rows = np.repeat(at, HEADINGS)
        self.pose: Array = np.column_stack([self._spot[self.place], np.tile(yaw, len(at))])
        self.cells: Rows = field.chart.visible(outlook, self.pose)
        self._links = links
        fruitful = field.chart.wanted[self.cells].any(axis=1)
        self.pose, self.cells = self.pose[fruitful], self.cells[fruitful]
        self.place = self.place[fruitful]

    def distance(self, position: Array) -> Array:
        """(V,) length of the way from a position to each viewpoint, m; inf if there is none."""
        if not len(self._spot):
            return np.zeros(0)
        start = int(np.argmin(((self._spot - position[:2]) ** 2).sum(axis=1)))
        ways: Array = dijkstra(self._links, directed=False, indices=np.array([start]))
        way: Array = ways[0, self.place]
        return way


def _lattice(field: Field) -> tuple[Array, csr_array]:
    """Places where an agent may be, (P, 2), m, and the lengths of the ways between neighbours."""
    step = SPACING * field.chart.cell
    if not field.parts:
        return np.zeros((0, 2)), csr_array((0, 0))
    west, south, east, north = shapely.total_bounds(field.parts)
    x, y = np.arange(west, east, step) + 1e-6, np.arange(south, north, step) + 1e-6
    free = np.zeros((len(x) + 2, len(y) + 2), np.bool_)  # with a border that is not free
    for part in field.parts:
        shapely.prepare(part)
        free[1:-1, 1:-1] |= shapely.contains_xy(part, *np.meshgrid(x, y, indexing="ij"))
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
