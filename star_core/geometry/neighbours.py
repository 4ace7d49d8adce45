"""Pairs of agents that are close to each other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows, every
from star_core.toolkit.jit import compiled

MANY = 64
"""Agents from which on they are sorted along the longer side; below, all pairs are compared."""

ROUNDING = 1e-9  # m, of a sum of coordinates


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
        n = len(position)
        if n < MANY:
            return cls(*_nearer(position.copy(), np.arange(n), np.full(n, n), float(reach)))
        axes = position.T.copy()
        sides = np.fmax.reduce(axes, axis=1) - np.fmin.reduce(axes, axis=1)  # without NaN
        if sides[1] > sides[0]:
            position = position[:, [1, 0, 2]].copy()
        order = np.argsort(position[:, 0])
        x = position[order, 0]
        ends = np.searchsorted(x, x + reach + ROUNDING)
        return cls(*_nearer(position[order], order, ends, float(reach)))

    def within(self, reach: float) -> Self:
        """Return the pairs that are nearer than a smaller distance, m."""
        return self.where(self.distance < reach)  # NaN is not

    def where(self, mask: Mask) -> Self:
        """Return the pairs that are True in `mask`, (P,)."""
        if every(mask):
            return self
        return type(self)(self.first[mask], self.second[mask], self.distance[mask])


@compiled
def _nearer(position: Array, order: Rows, ends: Rows, reach: float) -> tuple[Rows, Rows, Array]:
    """Return the rows of those nearer than `reach`, m, the smaller row first, and their distances.

    Args:
        position: (N, 3) m, in any order of the axes.
        order: (N,) their rows in the swarm.
        ends: (N,) end of the positions that are compared with each of them, which follow it.
        reach: m.
    """
    most, count = 0, 0
    for i in range(len(order)):
        most += max(ends[i] - i - 1, 0)
    first, second, distance = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most)
    for i in range(len(order)):
        for j in range(i + 1, ends[i]):
            x, y = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
            if not abs(y) < reach:  # true of most pairs of a large swarm
                continue
            z = position[i, 2] - position[j, 2]
            apart = math.sqrt(x * x + y * y + z * z)
            if apart < reach:  # NaN is not
                first[count], second[count] = min(order[i], order[j]), max(order[i], order[j])
                distance[count] = apart
                count += 1
    return first[:count], second[:count], distance[:count]
