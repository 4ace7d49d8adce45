"""The agents of a step: their positions, and goals for them in whole-swarm tables."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Estimate, Goals, Rows, Scene

SLOW = 0.15  # m/s: a slower agent has stopped, within the accuracy of its estimate


class StepAgents:
    """The agents of a step.

    Their tables have K rows, in the order of `rows`.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents in whole-swarm tables.

    Attributes:
        scene: The mission's scene.
        rows: (K,) rows of the agents in whole-swarm tables.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...]) -> None:
        self.scene = scene
        self.rows: Rows = np.array(rows, np.int64)
        self._active = np.zeros(len(scene.agents), np.bool_)
        self._active[self.rows] = True

    def keep(self, rows: tuple[int, ...]) -> np.ndarray:
        """Remove all agents but some; return which of the K these are, (K,)."""
        kept = np.isin(self.rows, rows)
        self.rows = self.rows[kept]
        self._active = np.zeros_like(self._active)
        self._active[self.rows] = True
        return kept

    def replace(self, old: int, new: int) -> None:
        """Replace an agent by another."""
        self.rows = np.where(self.rows == old, new, self.rows)
        self._active = np.zeros_like(self._active)
        self._active[self.rows] = True

    def located(self, estimate: Estimate) -> bool:
        """Whether all of them are located."""
        return bool(estimate.valid[self.rows].all())

    def farthest(self, estimate: Estimate, point: Array) -> float:
        """Return the greatest distance of an agent from its row of `point` (K, 3), m.

        An agent that is not located is infinitely far.
        """
        if not self.located(estimate):
            return math.inf
        away = estimate.position[self.rows] - point
        return math.sqrt(np.vecdot(away, away).max())

    def slow(self, estimate: Estimate) -> bool:
        """Whether all of them have stopped."""
        velocity = estimate.velocity[self.rows]
        return bool(np.vecdot(velocity, velocity).max() < SLOW**2)

    def journey(self, estimate: Estimate, point: Array | None) -> float:
        """Return the longest distance to `point` (K, 3), m; if unknown, the fence's diagonal."""
        fence = self.scene.world.fence
        far = math.inf if point is None else self.farthest(estimate, point)
        return min(far, math.dist(fence.low, fence.high))

    def goals(
        self, position: Array, yaw: Array, speed: float, velocity: Array | None = None
    ) -> Goals:
        """Return goals for the whole swarm, active for these agents.

        Args:
            position: (K, 3) m.
            yaw: (K,) rad.
            speed: Speed limit on the way, m/s.
            velocity: (K, 3) feed-forward, m/s; zero if not given.
        """
        n = len(self._active)
        positions, velocities, yaws = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n)
        positions[self.rows] = position
        yaws[self.rows] = yaw
        if velocity is not None:
            velocities[self.rows] = velocity
        return Goals(positions, velocities, yaws, np.full(n, speed), self._active)
