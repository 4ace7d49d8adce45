"""Pairs of agents that are close to each other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Self

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows, every
from star_core.toolkit.jit import compiled

MANY = 64
"""Agents from which on neighbours are found in the order of x, by a kernel; below, by all pairs."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Every two agents that are nearer than a distance to each other.

    Attributes:
        first: (P,) row of one agent of each pair, the smaller one.
        second: (P,) row of the other.
        distance: (P,) between the two, m.
    """

    first: Rows
    second: Rows
    distance: Array

    @classmethod
    def of(cls, position: Array, reach: float) -> Self:
        """Return the pairs nearer than `reach`, m; their order is the same for the same positions.

        Agents without a position (NaN) are left out.

        Args:
            position: (N, 3) m.
            reach: m.

        Example:
            >>> near = Pairs.of(np.array([[0.0, 0, 0], [5, 0, 0], [0, 1, 0]]), 2.0)
            >>> near.first.tolist(), near.second.tolist(), near.distance.tolist()
            ([0], [2], [1.0])
        """
        if len(position) < MANY:
            first, second = _every_pair(len(position))
            return cls(first, second, _apart(position, first, second)).within(reach)
        order = np.argsort(position[:, 0])
        found = _swept(np.ascontiguousarray(position[order]), float(reach))
        one, other = order[found[0]], order[found[1]]
        first, second = np.minimum(one, other), np.maximum(one, other)
        return cls(first, second, _apart(position, first, second))

    def within(self, reach: float) -> Self:
        """Return the pairs that are nearer than a smaller distance, m."""
        return self.where(self.distance < reach)  # NaN is not

    def where(self, wanted: Mask) -> Self:
        """Return the pairs that are True in `wanted`, (P,)."""
        if every(wanted):
            return self
        return type(self)(self.first[wanted], self.second[wanted], self.distance[wanted])


def warm_up(agents: int) -> None:
    """Compile the search among many agents, or load it from disk, before the flight.

    Agents that are not heard have several possible positions, so fewer than `MANY` may need it.
    """
    if agents >= MANY // 2:
        Pairs.of(np.zeros((MANY, 3)), 0.0)


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
                    for k in range(count):  # a slice would take seconds to compile
                        more[0, k], more[1, k] = rows[0, k], rows[1, k]
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
    return np.ascontiguousarray(first), np.ascontiguousarray(second)
