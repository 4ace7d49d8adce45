"""Counts agents that make no progress: temporary waits and deadlocks."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from star_core.geometry.neighbours import pairs
from star_core.messages.arrays import Array, Mask
from star_core.messages.events import Tick
from star_core.messages.state import AgentPhase, Paths

MAX_WAIT: Final = 5.0  # s without progress
MIN_PROGRESS: Final = 0.05  # m closer to the goal than before, or than `RECENT` ago
SAMPLE_PERIOD: Final = 0.25  # s
RECENT: Final = 1.0  # s; an agent that got closer since then is moving
ARRIVED: Final = 0.3  # m; no deadlock this close to the goal, where agents queue for a tight spot
WAITING_DISTANCE: Final = 1.5
"""Distance within which an agent can wait for another, m: two that meet at 0.5 m/s need it
to react, to brake and to let one pass. An unrelated agent that progresses moves away, after which
the deadlock is counted."""


class Deadlocks:
    """Counts agents that make no progress: all as waits, and some of them as deadlocks.

    An agent waits if it has not arrived and got no closer to its goal for `MAX_WAIT`, measured
    along the rest of its planned path. Agents whose goals move are not considered.

    It waits for the agents ahead of it, within `WAITING_DISTANCE`, and transitively for those that
    these wait for. While any of them has progressed within `MAX_WAIT`, or is moving to its goal,
    the wait can end: a queue, or an agent that gave way and comes back. Otherwise it is a deadlock:
    no active agent can be reached in the wait-for graph. An agent that stands still with no agent
    ahead, or only with agents that have arrived, is in a deadlock too; so is one that moves back
    and forth, at its next turn.

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
        self._best = np.full(agents, np.inf)  # m left, the smallest so far
        self._lefts: deque[Array] = deque(
            maxlen=round(RECENT / SAMPLE_PERIOD)
        )  # m, at the last samples
        self._since = np.zeros(agents)  # s, of the last progress
        self._waits = np.zeros(agents, np.bool_)  # has been counted
        self._deadlocked = np.zeros(agents, np.bool_)  # has been counted
        self._due = -np.inf  # s, time of the next sample

    def add(self, tick: Tick) -> None:
        """Take in one tick."""
        if tick.time < self._due:
            return
        self._due = tick.time + SAMPLE_PERIOD
        goals = tick.goals
        flies = goals.active & (tick.health.phase == int(AgentPhase.FLYING))
        goal = np.where(flies[:, None], goals.position, np.nan)
        new = ~(goal == self._goal).all(axis=1)
        self._goal = goal
        left = remaining(tick.estimate.position, goals.position, tick.plan.paths)
        better = new | ~(left > self._best - MIN_PROGRESS)
        self._best = np.where(better, left, self._best)
        self._since = np.where(better, tick.time, self._since)
        patient = tick.time - self._since <= MAX_WAIT
        progressing = (
            flies & (patient | (left < self._lefts[0] - MIN_PROGRESS)) if self._lefts else flies
        )
        self._lefts.append(left)
        stuck = flies & ~patient & (left > ARRIVED)
        self.waits += int((stuck & ~self._waits).sum())
        self._waits = (self._waits | stuck) & ~better
        if stuck.any():
            wanted = tick.plan.setpoint.velocity
            stuck &= ~waiting(tick.estimate.position, wanted, progressing)
        self.count += int((stuck & ~self._deadlocked).sum())
        self._deadlocked = (self._deadlocked | stuck) & ~better


def waiting(position: Array, wanted: Array, progressing: Mask) -> Mask:
    """Return (N,) which agents progress, or wait (transitively) for one that does.

    Args:
        position: (N, 3) where agents are, m.
        wanted: (N, 3) where each wants to go, m/s.
        progressing: (N,) which agents progress.

    Example:
        >>> queue = np.array([[0.0, 0, 0], [0.5, 0, 0], [1, 0, 0]])
        >>> waiting(queue, np.array([[1.0, 0, 0]] * 3), np.array([False, False, True]))
        array([ True,  True,  True])
        >>> waiting(queue, np.array([[1.0, 0, 0]] * 3), np.array([True, False, False]))
        array([ True, False, False])
    """
    first, second = pairs(position, WAITING_DISTANCE)
    waits, ahead = np.concatenate([first, second]), np.concatenate([second, first])
    towards = np.vecdot(position[ahead] - position[waits], wanted[waits]) > 0
    waits, ahead = waits[towards], ahead[towards]
    answer = progressing.copy()
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
