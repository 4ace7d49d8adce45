"""What a report plots over time, computed from the arrays of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from star_core import AgentPhase, Array, Mask, Rows, Run

AIRBORNE = (AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LANDING, AgentPhase.LOST)


class Nearest(NamedTuple):
    """The least distance at each tick, and where it was least of all.

    Attributes:
        distance: (T,) m; NaN where there is none.
        tick: Of the least distance; None if there is none.
        between: (2, 3) positions of what came closest, m; twice the agent's beside an obstacle.
        text: What came closest, how close and when.
    """

    distance: Array
    tick: int | None = None
    between: Array = np.full((2, 3), np.nan)
    text: str = ""

    @property
    def least(self) -> float:
        """Return the least distance of all, m."""
        return float(self.distance[self.tick]) if self.tick is not None else float("nan")


def positions(run: Run) -> Array:
    """Return (T, N, 3) true positions, or the estimated ones if there is no ground truth, m."""
    return run.arrays.get("truth_position", run.arrays["estimate_position"])


def airborne(run: Run) -> Mask:
    """Return (T, N) whether each agent is in the air."""
    return np.isin(run.arrays["phase"], AIRBORNE)


def errors(run: Run) -> tuple[Array, Array] | None:
    """Return position error and three standard deviations of it, (T, N) m; None without truth.

    NaN on the ground. The standard deviation is the root of the covariance's trace, which is the
    expected root mean square of the error.
    """
    if "truth_position" not in run.arrays:
        return None
    offset = run.arrays["estimate_position"] - run.arrays["truth_position"]
    flying = airborne(run)
    error = np.where(flying, np.linalg.norm(offset, axis=2), np.nan)
    std = run.arrays.get("estimate_position_std", np.full(offset.shape, np.nan))
    return error, np.where(flying, 3 * np.linalg.norm(std, axis=2), np.nan)


def separation(run: Run) -> Nearest:
    """Return the distance between the two nearest agents in the air at each tick."""
    where = _in_the_air(run)
    first, second = np.triu_indices(len(run.agents), 1)
    distance = np.linalg.norm(where[:, first] - where[:, second], axis=2)
    names = [run.agents[j] for j in second]
    return _nearest(run, distance, np.stack([first, second], axis=1), names)


def clearance(run: Run) -> Nearest:
    """Return the distance from the nearest obstacle to an agent in the air at each tick."""
    where = _in_the_air(run)
    finite = np.isfinite(where).all(axis=2)
    ticks, agents = finite.shape
    obstacles = run.world.obstacles
    distance = np.full((ticks, len(obstacles), agents), np.nan)
    for k, obstacle in enumerate(obstacles):
        distance[:, k][finite] = obstacle.distances(where[finite])
    pairs = np.tile(np.arange(agents)[:, None], (len(obstacles), 2))
    names = [obstacle.name for obstacle in obstacles for _ in run.agents]
    return _nearest(run, distance.reshape(ticks, len(names)), pairs, names)


def peaks(x: Array, y: Array, most: int) -> tuple[Array, Array]:
    """Return `most` points of a line at the most: those with the greatest `y` of their neighbours.

    >>> peaks(np.arange(5.0), np.array([1.0, 3.0, 2.0, 0.0, 5.0]), 3)
    (array([1., 2., 4.]), array([3., 2., 5.]))
    """
    size = -(-len(x) // most)
    starts = np.arange(0, len(x), size)
    chosen = [int(start + np.argmax(y[start : start + size])) for start in starts]
    return x[chosen], y[chosen]


def _in_the_air(run: Run) -> Array:
    """Return (T, N, 3) positions, m; NaN on the ground."""
    return np.where(airborne(run)[..., None], positions(run), np.nan)


def _nearest(run: Run, distance: Array, pairs: Rows, names: Sequence[str]) -> Nearest:
    """Return the least of (T, K) distances, m, at each tick.

    They are those of the agents in (K, 2) `pairs`, or of an agent, twice there, from an obstacle;
    `names` are those of what is near the first of each pair.
    """
    least: Array = np.fmin.reduce(distance, axis=1, initial=np.nan)
    if np.isnan(least).all():
        return Nearest(least)
    tick = int(np.nanargmin(least))
    k = int(np.nanargmin(distance[tick]))
    both = f"{run.agents[pairs[k, 0]]} and {names[k]}"
    text = f"{both}: {least[tick]:.2f} m at {run.arrays['time'][tick]:.2f} s"
    return Nearest(least, tick, positions(run)[tick, pairs[k]], text)
