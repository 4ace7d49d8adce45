"""What a report plots over time, computed from the arrays of a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from star_core import AgentPhase, Array, Mask, Run

AIRBORNE = (
    AgentPhase.TAKING_OFF,
    AgentPhase.FLYING,
    AgentPhase.LANDING,
    AgentPhase.LOST,
)


class Nearest(NamedTuple):
    """The least distance at each tick, and where it was least of all.

    Attributes:
        distance: (T,) m; NaN where there is none.
        tick: Of the least distance; None if there is none.
        position: (3,) where that was, m.
        names: Of what came closest.
    """

    distance: Array
    tick: int | None
    position: Array
    names: str


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
    where = np.where(airborne(run)[..., None], positions(run), np.nan)
    first, second = np.triu_indices(where.shape[1], 1)
    distance = np.linalg.norm(where[:, first] - where[:, second], axis=2)
    least = _least(distance, axis=1)
    if np.isnan(least).all():
        return Nearest(least, None, np.full(3, np.nan), "")
    tick = int(np.nanargmin(least))
    pair = int(np.nanargmin(distance[tick]))
    i, j = int(first[pair]), int(second[pair])
    names = f"{run.agents[i]} and {run.agents[j]}"
    return Nearest(least, tick, (where[tick, i] + where[tick, j]) / 2, names)


def clearance(run: Run) -> Nearest:
    """Return the distance from the nearest obstacle to an agent in the air at each tick."""
    where = np.where(airborne(run)[..., None], positions(run), np.nan)
    obstacles = run.world.obstacles
    if not obstacles:
        return Nearest(np.full(len(where), np.nan), None, np.full(3, np.nan), "")
    known = np.isfinite(where).all(axis=2)
    distance = np.full((len(obstacles), *known.shape), np.nan)
    for k, obstacle in enumerate(obstacles):
        distance[k][known] = obstacle.distances(where[known])
    least = _least(np.moveaxis(distance, 1, 0).reshape(len(where), -1), axis=1)
    if np.isnan(least).all():
        return Nearest(least, None, np.full(3, np.nan), "")
    tick = int(np.nanargmin(least))
    k, i = divmod(int(np.nanargmin(distance[:, tick])), distance.shape[2])
    return Nearest(least, tick, where[tick, i], f"{run.agents[i]} and {obstacles[k].name}")


def _least(values: Array, axis: int) -> Array:
    """Return the least values along an axis; NaN where there is none."""
    least: Array = np.where(np.isnan(values), np.inf, values).min(axis=axis, initial=np.inf)
    return np.where(np.isinf(least), np.nan, least)
