"""Who has a goal and gets no nearer to it: because it waits for its turn, or for ever."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from star_core.flight import Tick
from star_core.near import pairs
from star_core.swarm import AgentPhase, Paths
from star_core.table import Array, Mask

PATIENCE: Final = 5.0  # s without progress
PROGRESS: Final = 0.05  # m nearer than ever before, or than `LATELY`
EVERY: Final = 0.25  # s from one look to the next
LATELY: Final = 1.0  # s ago: who is nearer since is under way
ARRIVED: Final = 0.3  # m: no deadlock so near, where agents wait for a tight place
NEAR: Final = 1.5
"""Distance within which an agent waits for another, m: what two that meet at the usual 0.5 m/s need
to see each other, to brake and to let one pass. Who gets on and has nothing to do with it goes
away, and then a deadlock is counted all the same."""


class Deadlocks:
    """Counts who stands still: all of them as waits, and as deadlocks those that wait for nobody.

    An agent waits if it is not there and got no nearer for `PATIENCE`. What counts is the rest of
    the way that the planner means to fly. Agents whose goals move are left out.

    It waits for those ahead of it, within `NEAR`, and for those these wait for in their turn. While
    one of all these has got nearer to its own goal within `PATIENCE`, or is under way to it, the
    wait can end: that is a queue, or one that made room for others and comes back. Where none is,
    it is a deadlock: nobody can go before another does, as with processes that wait for each other
    and reach no active one in their wait-for graph. One that stands still with nobody ahead, or
    only with agents that have arrived, is in a deadlock too; so is one that goes to and fro, at
    its next turn.

    Args:
        agents: How many there are.

    Attributes:
        waits: How many waits there were, each counted once until the agent gets on.
        count: How many of them became deadlocks.
    """

    def __init__(self, agents: int) -> None:
        self.waits = 0
        self.count = 0
        self._goal = np.full((agents, 3), np.nan)
        self._best = np.full(agents, np.inf)  # m left, the least so far
        self._lefts: deque[Array] = deque(maxlen=round(LATELY / EVERY))  # m, at the last looks
        self._since = np.zeros(agents)  # s, of the last progress
        self._waits = np.zeros(agents, np.bool_)  # has been counted
        self._deadlocked = np.zeros(agents, np.bool_)  # has been counted
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
        patient = tick.time - self._since <= PATIENCE
        gets_on = flies & (patient | (left < self._lefts[0] - PROGRESS)) if self._lefts else flies
        self._lefts.append(left)
        stuck = flies & ~patient & (left > ARRIVED)
        self.waits += int((stuck & ~self._waits).sum())
        self._waits = (self._waits | stuck) & ~better
        if stuck.any():
            wanted = tick.plan.setpoint.velocity
            stuck &= ~waiting(tick.estimate.position, wanted, gets_on)
        self.count += int((stuck & ~self._deadlocked).sum())
        self._deadlocked = (self._deadlocked | stuck) & ~better


def waiting(position: Array, wanted: Array, gets_on: Mask) -> Mask:
    """Return who gets on, or waits for somebody who does: (N,).

    Args:
        position: (N, 3) where agents are, m.
        wanted: (N, 3) where each wants to go, m/s.
        gets_on: (N,) who gets on.

    Example:
        >>> queue = np.array([[0.0, 0, 0], [0.5, 0, 0], [1, 0, 0]])
        >>> waiting(queue, np.array([[1.0, 0, 0]] * 3), np.array([False, False, True]))
        array([ True,  True,  True])
        >>> waiting(queue, np.array([[1.0, 0, 0]] * 3), np.array([True, False, False]))
        array([ True, False, False])
    """
    first, second = pairs(position, NEAR)
    waits, ahead = np.concatenate([first, second]), np.concatenate([second, first])
    towards = np.vecdot(position[ahead] - position[waits], wanted[waits]) > 0
    waits, ahead = waits[towards], ahead[towards]
    answer = gets_on.copy()
    while (more := answer[ahead] & ~answer[waits]).any():
        answer[waits[more]] = True
    return answer


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
