"""The current paths of the agents, as tables with one row per agent."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Paths, Rows

SHARP = 1e-6  # rad; a smaller angle is not a turn


class TrackedPaths:
    """Paths of a whole swarm.

    Args:
        n: Number of agents.
        look_ahead: Length over which a corner is rounded, m.
        acceleration: Greatest acceleration in turns, m/s².

    Attributes:
        path: (N, M, 3) points of each path, without its start, m.
        count: (N,) their numbers; 0 for none.
        leg: (N,) index of the point that the agent flies to.
        rest: (N, M) remaining length of the path beyond each point, m.
        pace: (N, M) speed limit there, m/s.
        start: (N, 3) position of the agent when its path was last requested, m; NaN if never.
        goal: (N, 3) goal for which it was requested, m; NaN if never.
        fault: Why there is no path, by row.
    """

    def __init__(self, n: int, *, look_ahead: float, acceleration: float) -> None:
        self._look_ahead = look_ahead
        self._acceleration = acceleration
        self.path: Array = np.zeros((n, 8, 3))
        self.count: Rows = np.zeros(n, np.int64)
        self.leg: Rows = np.zeros(n, np.int64)
        self.rest: Array = np.zeros((n, 8))
        self.pace: Array = np.zeros((n, 8))
        self.start: Array = np.full((n, 3), np.nan)
        self.goal: Array = np.full((n, 3), np.nan)
        self.fault: dict[int, str] = {}

    def forget(self, rows: Mask) -> None:
        """Clear the paths of some agents."""
        self.count[rows] = 0
        self.start[rows] = self.goal[rows] = np.nan
        for row in [row for row in self.fault if rows[row]]:
            del self.fault[row]

    def put(self, row: int, here: Array, goal: Array, found: Array | str) -> None:
        """Store the result of a search for an agent: (K, 3) points, m, or why there is no path."""
        self.start[row], self.goal[row] = here, goal
        self.leg[row] = self.count[row] = 0
        self.fault.pop(row, None)
        if isinstance(found, str):
            self.fault[row] = found
            return
        k = len(found)
        while k > self.path.shape[1]:
            self.path = np.concatenate([self.path, np.zeros_like(self.path)], axis=1)
            self.rest = np.concatenate([self.rest, np.zeros_like(self.rest)], axis=1)
            self.pace = np.concatenate([self.pace, np.zeros_like(self.pace)], axis=1)
        stretch = np.diff(np.vstack([here, found]), axis=0)
        length = np.sqrt((stretch**2).sum(axis=1))
        self.count[row] = k
        self.path[row, :k] = found
        self.rest[row, :k] = length.sum() - np.cumsum(length)
        self.pace[row, :k] = self._paces(stretch, length)

    def aim(self, rows: Mask, goal: Array) -> None:
        """Move the ends of some paths to `goal` (N, 3), m, which is close to them."""
        self.path[rows, self.count[rows] - 1] = goal[rows]

    def left(self, here: Array) -> tuple[Array, Array]:
        """Return (N,) the remaining length of each path, m, and (N,) its speed limit, m/s.

        The speed limit is such that the agent, braking as it does at a goal, is slow enough at the
        next corner.
        """
        every = np.arange(len(here))
        corner = self.path[every, self.leg]
        away = np.sqrt(((corner - here) ** 2).sum(axis=1))
        pace = self.pace[every, self.leg]
        return away + self.rest[every, self.leg], np.sqrt(pace**2 + 2 * self._acceleration * away)

    def paths(self, here: Array, direct: Mask, goal: Array, on: Mask) -> Paths:
        """Return the remaining paths: straight to the goal if `direct`, the path if `on`."""
        n, m = self.count.shape[0], self.path.shape[1]
        point = np.concatenate([here[:, None], self.path], axis=1)
        index = np.arange(1, m + 1)
        shown = np.zeros((n, m + 1), np.bool_)
        shown[:, 0] = direct | on
        shown[:, 1:] = on[:, None] & (index > self.leg[:, None]) & (index <= self.count[:, None])
        point[direct, 1], shown[direct, 1] = goal[direct], True
        return Paths(agent=np.nonzero(shown)[0], point=point[shown])

    def _paces(self, stretch: Array, length: Array) -> Array:
        """(K,) speed limit at each point.

        A path that turns by an angle within `look_ahead` is rounded to an arc of that length, which
        requires the acceleration v² angle / length. The agent brakes in time for slower points.
        """
        k = len(length)
        along = stretch / np.maximum(length, SHARP)[:, None]
        turn = np.arccos(np.clip((along[1:] * along[:-1]).sum(axis=1), -1.0, 1.0))  # (K - 1,)
        at = np.cumsum(length)
        pace = np.full(k, math.inf)
        pace[-1] = 0.0
        for i in range(k - 2, -1, -1):
            angle = float(turn[i:][at[i:-1] <= at[i] + self._look_ahead].sum())
            arc = math.sqrt(self._acceleration * self._look_ahead / max(angle, SHARP))
            pace[i] = min(arc, math.sqrt(pace[i + 1] ** 2 + 2 * self._acceleration * length[i + 1]))
        return pace
