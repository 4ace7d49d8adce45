"""Assignment of agents to positions."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from star_core import Array, Rows

TIE = 1e-6  # 1/m: cost of squared distances, which decides between assignments of equal total


def assign(position: Array, place: Array) -> Rows:
    """Return the position each agent takes, so that the total distance flown is minimal.

    Straight paths of minimal total length do not cross: uncrossing two paths shortens them, by the
    triangle inequality. Of assignments with equal totals, the one with the smallest sum of squares
    is taken, so that agents in a row do not overtake each other.

    Args:
        position: (K, 3) positions of the agents, m.
        place: (P, 3) available positions, one agent each, m; at least K of them.

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
