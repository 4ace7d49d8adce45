"""The planned paths of a recorded flight, each stored when it changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from star_core.messages.arrays import Array, Rows


@dataclass(frozen=True)
class PlannedPaths:
    """The arrays of ``paths.npz``: K points in the map, those of a path in consecutive rows.

    Attributes:
        time: (K,) mission time from which the path holds, until the next of its agent, s.
        agent: (K,) row of the agent.
        point: (K, 3) m. The agent's own position, where a path begins, is not among the points;
            one point of NaN if the agent has no path.
    """

    time: Array
    agent: Rows
    point: Array

    @classmethod
    def none(cls) -> PlannedPaths:
        """Return a table without a path."""
        return cls(np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 3)))

    def current(self, agent: int, times: Array) -> Rows:
        """Return (M,) the numbers of an agent's paths at (M,) mission times, s; -1: none."""
        rows = np.flatnonzero(self.agent == agent)
        numbers: Rows = np.append(-1, rows)[np.searchsorted(self.time[rows], times, side="right")]
        exists = np.isfinite(np.append(self.point[:, 0], np.nan))[numbers]  # the last: of -1
        return np.where(exists, numbers, -1)

    def points(self, number: int) -> Array:
        """Return the points of a path, (K, 3) m."""
        begin = int(np.searchsorted(self.time, self.time[number]))
        of_agent = self.agent[begin : number + 1] == self.agent[number]
        points: Array = self.point[begin : number + 1][of_agent]
        return points
