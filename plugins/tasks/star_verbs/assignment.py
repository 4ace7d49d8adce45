"""Which agent goes to which place."""

from __future__ import annotations

import numpy as np

from star_core import Array, Rows

TIE = 1e-6  # 1/m: makes one long and one short way dearer than two of the same total


def assign(position: Array, place: Array) -> Rows:
    """Return for each agent the place it should take, so that the distances flown add up to least.

    Of assignments with one total, the one with the least sum of squares is taken, so that agents in
    a row do not overtake each other.

    Args:
        position: (K, 3) where the agents are, m.
        place: (K, 3) where one agent each should go, m.

    Returns:
        (K,) row in `place` for each row in `position`.

    Example:
        >>> assign(np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([[1.1, 0, 0], [0.1, 0, 0]]))
        array([1, 0])
    """
    offset = position[:, None] - place[None, :]  # (K, K, 3)
    distance = np.sqrt((offset**2).sum(axis=2))
    return _cheapest(distance + TIE * distance**2)


def _cheapest(cost: Array) -> Rows:
    """Solve the assignment problem for a square cost matrix; returns the column of each row.

    Shortest augmenting paths with dual prices, as in D. F. Crouse, "On implementing 2D rectangular
    assignment algorithms", IEEE Trans. AES 52(4), 2016. SciPy has the same, but importing it takes
    half a second, which a swarm in the air cannot wait for.
    """
    n = len(cost)
    row_price, column_price = np.zeros(n), np.zeros(n)
    column_of, row_of = np.full(n, -1), np.full(n, -1)
    for start in range(n):
        shortest = np.full(n, np.inf)  # length of the cheapest path to each column
        reached_from = np.full(n, -1)
        closed = np.zeros(n, np.bool_)
        row, length = start, 0.0
        while True:
            reach = length + cost[row] - row_price[row] - column_price
            better = ~closed & (reach < shortest)
            shortest[better] = reach[better]
            reached_from[better] = row
            column = int(np.argmin(np.where(closed, np.inf, shortest)))
            length = float(shortest[column])
            closed[column] = True
            if row_of[column] < 0:
                break
            row = int(row_of[column])
        passed = closed & (row_of >= 0)
        row_price[start] += length
        row_price[row_of[passed]] += length - shortest[passed]
        column_price[closed] -= length - shortest[closed]
        while True:  # hand the columns on along the path
            row = int(reached_from[column])
            row_of[column] = row
            column_of[row], column = column, int(column_of[row])
            if row == start:
                break
    return column_of
