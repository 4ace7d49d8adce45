"""The verb ``land``: descend straight down and stop the motors."""

from __future__ import annotations

import numpy as np

from star_core import AgentPhase, Command, Estimate, Health, Order, Scene, Status, Step
from star_verbs.crew import Crew
from star_verbs.timeouts import time_out

LEAST_DURATION = 1.0  # s
GROUNDED, LANDED = int(AgentPhase.GROUNDED), int(AgentPhase.LANDED)
TAKING_OFF, FLYING = int(AgentPhase.TAKING_OFF), int(AgentPhase.FLYING)


class Land:
    """Has the on-board commanders of the agents that are up descend to the floor of the map.

    It does not wait for anybody to be located: an agent whose height is not known is given the time
    that a descent from the greatest height takes.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        speed: Mean speed of the descent, m/s; the scene's limit at most.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], *, speed: float) -> None:
        self._crew = Crew(scene, rows)
        self._speed = min(speed, scene.limits.speed)

    def begin(self, estimate: Estimate, health: Health) -> float:
        return time_out(float(self._duration(estimate).max()))

    def step(self, estimate: Estimate, health: Health) -> Step:
        rows = self._crew.rows
        phase = health.phase[rows]
        if ((phase == GROUNDED) | (phase == LANDED)).all():
            return Step(status=Status.SUCCESS)
        up = (phase == TAKING_OFF) | (phase == FLYING)
        if not up.any():
            return Step()
        floor = np.where(estimate.valid[rows, None], estimate.position[rows], 0.0)
        floor[:, 2] = 0.0
        yaw = np.where(estimate.valid[rows], estimate.yaw[rows], 0.0)
        duration = self._duration(estimate)
        return Step(commands=(Command(Order.LAND, rows[up], floor[up], yaw[up], duration[up]),))

    def stay(self, rows: tuple[int, ...]) -> None:
        self._crew.stay(rows)

    def swap(self, old: int, new: int) -> None:
        self._crew.swap(old, new)

    def _duration(self, estimate: Estimate) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(K,) time of each agent's descent, s."""
        rows = self._crew.rows
        top = self._crew.scene.limits.height[1]
        height = np.where(estimate.valid[rows], estimate.position[rows, 2], top)
        return np.maximum(height / self._speed, LEAST_DURATION)
