"""Pairs of agents that are close to each other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows, every, frozen
from star_core.toolkit.jit import compiled, subroutine

MANY = 64
"""Agents from which on neighbours are found in the order of x; below, among all pairs."""

ROUNDING = 1e-9  # share of a distance, and m, that covers its rounding


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
            return cls(*_nearer(position, float(reach)))
        order = np.argsort(position[:, 0])
        return cls(*_swept(position[order], order, float(reach)))

    def within(self, reach: float) -> Self:
        """Return the pairs that are nearer than a smaller distance, m."""
        return self.where(self.distance < reach)  # NaN is not

    def where(self, mask: Mask) -> Self:
        """Return the pairs that are True in `mask`, (P,)."""
        if every(mask):
            return self
        return type(self)(self.first[mask], self.second[mask], self.distance[mask])


def warm_up(agents: int) -> None:
    """Compile the search among many agents, or load it from disk, before the flight.

    Agents that are not heard have several possible positions, so fewer than `MANY` may need it.
    """
    Pairs.of(frozen(np.zeros((2, 3))), 0.0)
    if agents >= MANY // 2:
        Pairs.of(np.zeros((MANY, 3)), 0.0)


@compiled
def _nearer(position: Array, reach: float) -> tuple[Rows, Rows, Array]:
    """Return the rows of those nearer than `reach`, m, the smaller row first, and their distances.

    Args:
        position: (N, 3) m.
        reach: m.
    """
    n, count = len(position), 0
    most = n * (n - 1) // 2
    first, second, distance = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most)
    for i in range(n):
        for j in range(i + 1, n):
            x, y = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
            z = position[i, 2] - position[j, 2]
            apart = math.sqrt(x * x + y * y + z * z)
            if apart < reach:  # NaN is not
                first[count], second[count], distance[count] = i, j, apart
                count += 1
    return first[:count], second[:count], distance[:count]


@compiled
def _swept(  # noqa: C901, PLR0912 -- one loop over agents, strips and neighbors
    position: Array, order: Rows, reach: float
) -> tuple[Rows, Rows, Array]:
    """Return the rows of those nearer than `reach`, m, the smaller row first, and their distances.

    The plane is cut into strips along x; those near an agent are in its strip or in the next ones.
    The pairs are in the order of x of the first agent, and then of the other.

    Args:
        position: (N, 3) m, in the order of x.
        order: (N,) their rows in the swarm.
        reach: m.
    """
    n, count = len(position), 0
    low, high = math.inf, -math.inf
    for i in range(n):
        if math.isfinite(position[i, 1]):
            low, high = min(low, position[i, 1]), max(high, position[i, 1])
    width = max(reach * (1 + ROUNDING), (high - low) / n, ROUNDING)  # m; at most N + 1 strips
    strip, member = np.empty(n, np.int64), np.empty(n, np.int64)
    start, end = np.zeros(n + 4, np.int64), np.zeros(n + 4, np.int64)
    for i in range(n):
        finite = math.isfinite(position[i, 1])
        strip[i] = 1 + int((position[i, 1] - low) / width) if finite else -1
        if finite:
            end[strip[i]] += 1
    for k in range(1, n + 4):
        start[k] = start[k - 1] + end[k - 1]
        end[k - 1] = start[k - 1]
    for i in range(n):
        if strip[i] >= 0:
            member[end[strip[i]]] = i
            end[strip[i]] += 1
    first, second, distance = np.empty(4 * n, np.int64), np.empty(4 * n, np.int64), np.empty(4 * n)
    for i in range(n):
        if strip[i] < 0:
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        begin = count
        for near in range(strip[i] - 1, strip[i] + 2):
            while start[near] < end[near] and member[start[near]] <= i:
                start[near] += 1  # those before are done
            for k in range(start[near], end[near]):
                j = member[k]
                ahead, aside, above = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
                if not ahead < reach:  # what is NaN is not, and stands last
                    break
                apart = math.sqrt(ahead * ahead + aside * aside + above * above)
                if not apart < reach:
                    continue
                if count == len(first):
                    first, second, distance = longer(first), longer(second), longer(distance)
                slot = count
                while slot > begin and second[slot - 1] > j:  # in the order of x
                    second[slot], distance[slot] = second[slot - 1], distance[slot - 1]
                    slot -= 1
                first[count], second[slot], distance[slot] = i, j, apart
                count += 1
    for k in range(count):
        row, neighbor = order[first[k]], order[second[k]]
        first[k], second[k] = min(row, neighbor), max(row, neighbor)
    return first[:count], second[:count], distance[:count]


@subroutine
def longer(values: Any) -> Any:
    """Return an array of twice the length that begins with some values."""
    more = np.empty(2 * len(values), values.dtype)
    for k in range(len(values)):  # a slice would take seconds to compile
        more[k] = values[k]
    return more
