"""Positions at which an agent can come straight down: clear of agents, obstacles and fence."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.world.world import World

AGENT_CLEARANCE: Final = 0.25  # m in the plane between two landing positions; 0.12 m is a collision
OBSTACLE_CLEARANCE: Final = 0.1  # m in the plane to obstacles below
MAX_DRIFT: Final = 0.25  # m, the most that is added for an uncertain position, or an unknown one
DESCENT_DRIFT: Final = 0.1  # m, at most, by which an uncertain agent drifts on its way down
EXTRA_CLEARANCE: Final = 0.1  # m, added where an agent moves aside
SEARCH_STEP: Final = 0.05  # m between the candidates
SEARCH_RADIUS: Final = 3.0  # m


def free_position(
    start: Array,
    world: World,
    taken: Array,
    apart: Array | float,
    margin: float = 0.0,
    accepts: Callable[[Array], Mask] | None = None,
) -> Array | None:
    """Return the nearest position at which an agent can land: (2,) m; None if none is near.

    Its own is preferred; others keep `EXTRA_CLEARANCE` in addition.

    Args:
        start: (3,) position of the agent in the map, m.
        world: Its fence and its obstacles.
        taken: (K, 2) positions in the map that other agents take, m.
        apart: (K,) distances to keep from these, m, or one for all.
        margin: For the agent's uncertain position, to obstacles and fence, m.
        accepts: Returns which positions aside, (K, 2) m, the agent can fly to: (K,).

    Example:
        >>> from star_core import Fence
        >>> world = World("room", Fence((-2, -2, 0), (2, 2, 2)))
        >>> free_position(np.array([0.0, 0.0, 1.0]), world, np.zeros((1, 2)), 0.25).round(2)
        array([0.35, 0.  ])
    """
    point, top = start[:2], float(start[2])
    if is_free(point[None], world, taken, apart, top, margin)[0]:
        return point
    for radius in np.arange(SEARCH_STEP, SEARCH_RADIUS, SEARCH_STEP):
        count = math.ceil(math.tau * radius / SEARCH_STEP)
        angle = np.linspace(0.0, math.tau, count, endpoint=False)
        candidates = point + radius * np.column_stack([np.cos(angle), np.sin(angle)])
        free = is_free(candidates, world, taken, apart, top, margin, EXTRA_CLEARANCE)
        if accepts is not None:
            free[free] = accepts(candidates[free])
        if free.any():
            nearest: Array = candidates[np.argmax(free)]
            return nearest
    return None


def is_free(
    positions: Array,
    world: World,
    taken: Array,
    apart: Array | float,
    top: float,
    margin: float = 0.0,
    extra: float = 0.0,
) -> Mask:
    """Return at which positions an agent can land that comes down from a height: (K,).

    Args:
        positions: (K, 2) in the map, m.
        world: Its fence and its obstacles; those that begin above the agent do not matter.
        taken: (L, 2) positions that other agents take, m.
        apart: (L,) distances to keep from these, m, or one for all.
        top: Height of the agent, m.
        margin: For its uncertain position, to obstacles and fence, m.
        extra: Clearance to add for an agent that moves aside, m.
    """
    away = np.linalg.norm(positions[:, None] - taken[None], axis=2)
    free: Mask = (away >= np.asarray(apart) + extra).all(axis=1)
    kept = margin + extra
    if kept:
        low, high = np.array(world.fence.low[:2]) + kept, np.array(world.fence.high[:2]) - kept
        free &= ((positions >= low) & (positions <= high)).all(axis=1)
    for obstacle in world.obstacles:
        foot, crest = obstacle.height
        if foot < top:
            level = np.full((len(positions), 1), min(top, crest))
            away = obstacle.distances(np.hstack([positions, level]))
            free &= away >= OBSTACLE_CLEARANCE + margin + min(margin, DESCENT_DRIFT) + 2 * extra
    return free
