"""A trajectory as a line to fly along, parameterized by the time since its start."""

from __future__ import annotations

import numpy as np

import star_core
from star_core import Array
from star_verbs.follow.trajectory import Trajectory


class TimedPath:
    """Like `Path`, but parameterized by a trajectory's own time instead of the distance flown.

    Args:
        trajectory: Trajectory to fly.

    Attributes:
        length: Its duration, s.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self._trajectory = trajectory
        self.length = trajectory.duration

    def on_board(self) -> star_core.Trajectory:
        """Return the trajectory that agents fly on board."""
        pieces = self._trajectory.pieces
        return star_core.Trajectory(
            np.array([piece.duration for piece in pieces]),
            np.array([piece.polynomials for piece in pieces]),
        )

    def at(self, time: Array) -> tuple[Array, Array]:
        """Return (K, 3) points, m, and (K, 3) velocities, m/s, at (K,) times, s."""
        moments = [self._trajectory.at(one) for one in time.tolist()]
        point, velocity = [m.point for m in moments], [m.velocity for m in moments]
        return np.array(point).reshape(-1, 3), np.array(velocity).reshape(-1, 3)

    def yaw(self, time: Array) -> Array:
        """Return (K,) headings at (K,) times, rad."""
        return np.array([self._trajectory.at(one).yaw for one in time.tolist()])
