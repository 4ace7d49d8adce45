"""The verb ``land``: descend straight down and stop the motors."""

from __future__ import annotations

import numpy as np

from star_core import (
    AgentPhase,
    Command,
    Estimate,
    Health,
    Order,
    Scene,
    Status,
    TaskOutput,
    timeout,
)
from star_verbs.step_agents import StepAgents

LEAST_DURATION = 1.0  # s
GROUNDED, LANDED = int(AgentPhase.GROUNDED), int(AgentPhase.LANDED)
TAKING_OFF, FLYING = int(AgentPhase.TAKING_OFF), int(AgentPhase.FLYING)


class Land:
    """Commands the on-board commanders of airborne agents to descend to the floor of the map.

    It does not wait until agents are located: for an agent of unknown height the descent takes as
    long as one from the greatest height.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        speed: Mean speed of the descent, m/s; at most the scene's limit.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], *, speed: float) -> None:
        self._agents = StepAgents(scene, rows)
        self._speed = min(speed, scene.limits.speed)

    def begin(self, estimate: Estimate, health: Health) -> float:
        return timeout(float(self._duration(estimate).max()))

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        rows = self._agents.rows
        phase = health.phase[rows]
        if ((phase == GROUNDED) | (phase == LANDED)).all():
            return TaskOutput(status=Status.SUCCESS)
        up = (phase == TAKING_OFF) | (phase == FLYING)
        if not up.any():
            return TaskOutput()
        floor = np.where(estimate.valid[rows, None], estimate.position[rows], 0.0)
        floor[:, 2] = 0.0
        yaw = np.where(estimate.valid[rows], estimate.yaw[rows], 0.0)
        duration = self._duration(estimate)
        return TaskOutput(
            commands=(Command(Order.LAND, rows[up], floor[up], yaw[up], duration[up]),)
        )

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        self._agents.keep(rows)

    def on_agent_replaced(self, old: int, new: int) -> None:
        self._agents.replace(old, new)

    def _duration(self, estimate: Estimate) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(K,) time of each agent's descent, s."""
        rows = self._agents.rows
        top = self._agents.scene.limits.height[1]
        height = np.where(estimate.valid[rows], estimate.position[rows, 2], top)
        return np.maximum(height / self._speed, LEAST_DURATION)
