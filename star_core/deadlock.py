"""Who has a goal and gets no nearer to it."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core.flight import Tick
from star_core.swarm import AgentPhase, Paths
from star_core.table import Array

PATIENCE: Final = 5.0  # s without progress
PROGRESS: Final = 0.05  # m nearer than ever before
EVERY: Final = 0.25  # s from one look to the next
ARRIVED: Final = 0.3  # m: no deadlock so near, where agents wait for a tight place


class Deadlocks:
    """Counts deadlocks: an agent that is not there and for `PATIENCE` got no nearer.

    What counts is the rest of the way that the planner means to fly. Agents whose goals move are
    left out.

    Args:
        agents: How many there are.

    Attributes:
        count: How many there were, each counted once until the agent gets on.
    """

    def __init__(self, agents: int) -> None:
        self.count = 0
        self._goal = np.full((agents, 3), np.nan)
        self._best = np.full(agents, np.inf)  # m left, the least so far
        self._since = np.zeros(agents)  # s, of the last progress
        self._counted = np.zeros(agents, np.bool_)
        self._due = -np.inf  # s, when to look again

    def add(self, tick: Tick) -> None:
        """Take in one tick."""
        if tick.time < self._due:
            return
        self._due = tick.time + EVERY
        goals = tick.goals
        flies = goals.active & (tick.health.phase == int(AgentPhase.FLYING))
        goal = np.where(flies[:, None], goals.position, np.nan)
        new = ~(goal == self._goal).all(axis=1)
        self._goal = goal
        left = remaining(tick.estimate.position, goals.position, tick.plan.paths)
        better = new | ~(left > self._best - PROGRESS)
        self._best = np.where(better, left, self._best)
        self._since = np.where(better, tick.time, self._since)
        stuck = flies & ~better & (left > ARRIVED) & (tick.time - self._since > PATIENCE)
        self.count += int((stuck & ~self._counted).sum())
        self._counted = (self._counted | stuck) & ~better


def remaining(position: Array, goal: Array, paths: Paths) -> Array:
    """Return how long the ways are along planned paths, or straight where none is planned.

    Args:
        position: (N, 3) where agents are, m.
        goal: (N, 3) where they go, m.
        paths: The points of each agent's path, in order.

    Returns:
        (N,) m.

    Example:
        >>> corner = Paths(np.array([0, 0]), np.array([[3.0, 0, 0], [3, 4, 0]]))
        >>> remaining(np.zeros((2, 3)), np.array([[3.0, 4, 0], [0, 2, 0]]), corner)
        array([7., 2.])
    """
    left: Array = np.linalg.norm(goal - position, axis=1)
    rows = paths.agent
    if not len(rows):
        return left
    before = np.roll(paths.point, 1, axis=0)
    first = np.roll(rows, 1) != rows
    first[0] = True
    before[first] = position[rows[first]]
    along = np.zeros(len(left))
    np.add.at(along, rows, np.linalg.norm(paths.point - before, axis=1))
    left[rows] = along[rows]
    return left
