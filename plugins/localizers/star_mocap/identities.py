"""Which agent each measurement is of: labels that cannot be right, and markers without one."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from star_core import Array, Mask, Rows

UNKNOWN: Final = -1  # row of a measurement that is of no agent
GATE_SIGMAS: Final = 5.0
MIN_GATE: Final = 0.1  # m: in 50 ms odometry errs by less, even while a drone is knocked
START_GATE: Final = 0.3  # m, from the start in the mission: 0.15 m is an error for `star preflight`
FAR: Final = 1e6  # m², cost of a pair outside of the gate: more pairs always cost less


def gates(covariance: Array, std: float, lag: Array, located: Mask) -> Array:
    """Return how far from its prediction each agent's measurement may be: (N,) m.

    Args:
        covariance: (N, 3, 3) of the predictions, m².
        std: Standard deviation of the measurements along each axis, m.
        lag: (N,) m that each agent flies in the uncertainty of the measurements' time.
        located: (N,) agents that have been measured so far.
    """
    variance = np.diagonal(covariance, axis1=1, axis2=2).max(axis=1) + std**2 + lag**2
    flown: Array = np.maximum(MIN_GATE, GATE_SIGMAS * np.sqrt(variance))
    return np.where(located, flown, START_GATE)


def assign(
    label: Rows, position: Array, predicted: Array, gate: Array
) -> tuple[Rows, dict[int, int]]:
    """Return the agent of each measurement of one time, and the exchanged labels.

    A label within its agent's gate is right. All other measurements are assigned to the agents that
    are left by the least sum of squared distances (Kuhn, "The Hungarian method for the assignment
    problem", 1955), within the gates; a label that finds no agent is not used.

    Args:
        label: (K,) row of the agent that the system names; `UNKNOWN` for a marker without a label.
        position: (K, 3) m.
        predicted: (N, 3) positions of the agents at that time, m; NaN if unknown.
        gate: (N,) m.

    Returns:
        (K,) rows, `UNKNOWN` for measurements of no agent; and the rows of the agents whose
        measurements have the labels of others, by the rows of these.

    Example:
        >>> agents = np.array([[0.0, 0, 1], [1.0, 0, 1]])
        >>> points = np.array([[1.02, 0, 1], [0.01, 0, 1], [3.0, 0, 1]])
        >>> assign(np.array([-1, -1, -1]), points, agents, np.array([0.1, 0.1]))[0]
        array([ 1,  0, -1])
    """
    agent = np.full(len(label), UNKNOWN)
    named = label >= 0
    own = np.linalg.norm(position - predicted[label], axis=1)
    right = named & (own <= gate[label])
    agent[right] = label[right]
    rest = np.flatnonzero(~right)
    free = np.setdiff1d(np.flatnonzero(np.isfinite(predicted[:, 0])), label[right])
    if not (len(rest) and len(free)):
        return agent, {}
    offset = position[rest, None] - predicted[None, free]  # (R, F, 3)
    squared = np.einsum("rfi,rfi->rf", offset, offset)
    near = squared <= gate[free] ** 2
    rows, columns = linear_sum_assignment(np.where(near, squared, FAR))
    within = near[rows, columns]
    agent[rest[rows[within]]] = free[columns[within]]
    exchanged = rest[named[rest] & (agent[rest] != UNKNOWN)]
    return agent, dict(zip(label[exchanged].tolist(), agent[exchanged].tolist(), strict=True))
