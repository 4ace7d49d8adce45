"""Waits and deadlocks: agents that make no progress to their goals."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from star_core import AgentPhase, Array, Mask, Paths, Tick
from star_core.toolkit import Pairs

MAX_WAIT: Final = 5.0  # s without progress
MIN_PROGRESS: Final = 0.05  # m closer to the goal than before, or than `RECENT` s ago
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

    Attributes:
        waits: Number of waits; one ends when the agent progresses.
        count: Number of waits that became deadlocks.
    """

    def __init__(self, agents: int) -> None:
        self.waits = 0
        self.count = 0
        self._goal = np.full((agents, 3), np.nan)
        self._best = np.full(agents, np.inf)  # m, least remaining distance so far
        self._recent: deque[Array] = deque(maxlen=round(RECENT / SAMPLE_PERIOD))  # m, remaining
        self._since = np.zeros(agents)  # s, of the last progress
        self._waits = np.zeros(agents, np.bool_)  # has been counted
        self._deadlocked = np.zeros(agents, np.bool_)  # has been counted
        self._due = -np.inf  # s, time of the next sample

    def add(self, tick: Tick) -> None:
        """Count the waits and deadlocks that begin at a tick."""
        if tick.time < self._due:
            return
        self._due = tick.time + SAMPLE_PERIOD
        goals = tick.goals
        flies = goals.active & (tick.health.phase == int(AgentPhase.FLYING))
        goal = np.where(flies[:, None], goals.position, np.nan)
        new = ~(goal == self._goal).all(axis=1)
        self._goal = goal
        remaining = remaining_distance(tick.estimate.position, goals.position, tick.plan.paths)
        better = new | ~(remaining > self._best - MIN_PROGRESS)
        self._best = np.where(better, remaining, self._best)
        self._since = np.where(better, tick.time, self._since)
        patient = tick.time - self._since <= MAX_WAIT
        progressing = (
            flies & (patient | (remaining < self._recent[0] - MIN_PROGRESS))
            if self._recent
            else flies
        )
        self._recent.append(remaining)
        stuck = flies & ~patient & (remaining > ARRIVED)
        self.waits += int((stuck & ~self._waits).sum())
        self._waits = (self._waits | stuck) & ~better
        if stuck.any():
            planned = tick.plan.setpoint.velocity
            near = Pairs.of(tick.estimate.position, WAITING_DISTANCE)
            stuck &= ~waiting(near, tick.estimate.position, planned, progressing)
        self.count += int((stuck & ~self._deadlocked).sum())
        self._deadlocked = (self._deadlocked | stuck) & ~better


def waiting(near: Pairs, position: Array, velocity: Array, progressing: Mask) -> Mask:
    """Return (N,) which agents progress, or wait (transitively) for one that does.

    Args:
        near: Pairs of agents that can wait for each other.
        position: (N, 3) of the agents, m.
        velocity: (N, 3) planned velocities, m/s.
        progressing: (N,) which agents progress.

    Example:
        >>> queue = np.array([[0.0, 0, 0], [0.5, 0, 0], [1, 0, 0]])
        >>> near = Pairs.of(queue, WAITING_DISTANCE)
        >>> waiting(near, queue, np.array([[1.0, 0, 0]] * 3), np.array([False, False, True]))
        array([ True,  True,  True])
        >>> waiting(near, queue, np.array([[1.0, 0, 0]] * 3), np.array([True, False, False]))
        array([ True, False, False])
    """
    first, second = near.first, near.second
    waits, ahead = np.concatenate([first, second]), np.concatenate([second, first])
    towards = np.vecdot(position[ahead] - position[waits], velocity[waits]) > 0
    waits, ahead = waits[towards], ahead[towards]
    answer = progressing.copy()
    while (more := answer[ahead] & ~answer[waits]).any():
        answer[waits[more]] = True
    return answer


def remaining_distance(position: Array, goal: Array, paths: Paths) -> Array:
    """Return the distances to goals along planned paths, or straight where none is planned.

    Args:
        position: (N, 3) of the agents, m.
        goal: (N, 3) of the agents, m.
        paths: The points of each agent's path, in order.

    Returns:
        (N,) m.

    Example:
        >>> corner = Paths(np.array([0, 0]), np.array([[3.0, 0, 0], [3, 4, 0]]))
        >>> remaining_distance(np.zeros((2, 3)), np.array([[3.0, 4, 0], [0, 2, 0]]), corner)
        array([7., 2.])
    """
    distance: Array = np.linalg.norm(goal - position, axis=1)
    rows = paths.agent
    if not len(rows):
        return distance
    before = position[rows]  # where the path of an agent begins, otherwise the point before
    same = np.flatnonzero(rows[1:] == rows[:-1])
    before[same + 1] = paths.point[same]
    step = paths.point - before
    along = np.bincount(rows, np.sqrt(np.vecdot(step, step)), len(distance))
    distance[rows] = along[rows]
    return distance
