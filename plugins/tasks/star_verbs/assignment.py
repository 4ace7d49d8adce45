"""Which agent goes to which place."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from star_core import Array, Rows

TIE = 1e-6  # 1/m: makes one long and one short way dearer than two of the same total


def assign(position: Array, place: Array) -> Rows:
    """Return for each agent the place it should take, so that the distances flown add up to least.

    Straight ways of the least total do not cross: uncrossed, two ways that cross are shorter by the
    triangle inequality. Of assignments with one total, the one with the least sum of squares is
    taken, so that agents in a row do not overtake each other.

    Args:
        position: (K, 3) where the agents are, m.
        place: (P, 3) where one agent each can go, m; at least K of them.

    Returns:
        (K,) row in `place` for each row in `position`.

    Example:
        >>> assign(np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([[1.1, 0, 0], [0.1, 0, 0]]))
        array([1, 0])
    """
    offset = position[:, None] - place[None, :]  # (K, P, 3)
    distance = np.sqrt((offset**2).sum(axis=2))
    place_of: Rows = linear_sum_assignment(distance + TIE * distance**2)[1]
    return place_of
