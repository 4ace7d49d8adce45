"""The verb ``takeoff``: climb straight up and hover there."""

from __future__ import annotations

import numpy as np

from star_core import (
    AgentPhase,
    Command,
    Estimate,
    Goals,
    Health,
    Order,
    Scene,
    Status,
    TaskOutput,
    timeout,
)
from star_verbs.step_agents import StepAgents

LEAST_DURATION = 1.0  # s
NEAR = 0.15  # m: greatest height error at which an agent has taken off
IN_THE_AIR = (AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LANDING)


class Takeoff:
    """Commands a climb by the on-board commanders, and a goal above each agent's position.

    It waits until all its agents are located, and fails at once if one is airborne already.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        height: z to climb to, map frame, m.
        speed: Mean speed of the climb, m/s; at most the scene's limit.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], *, height: float, speed: float) -> None:
        self._agents = StepAgents(scene, rows)
        self._height = height
        self._speed = min(speed, scene.limits.speed)
        self._goals: Goals | None = None

    def begin(self, estimate: Estimate, health: Health) -> float:
        foot = [agent.start[2] for agent in self._agents.scene.agents]
        return timeout(max(LEAST_DURATION, (self._height - min(foot)) / self._speed))

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        phase = health.phase[self._agents.rows]
        if self._goals is None:
            flying = self._agents.rows[np.isin(phase, IN_THE_AIR)]
            if len(flying):
                names = self._agents.scene.named(flying.tolist())
                return TaskOutput(status=Status.FAILURE, reason=f"already in the air: {names}")
            if not self._agents.located(estimate):
                return TaskOutput()
            return self._climb(estimate)
        off = abs(estimate.position[self._agents.rows, 2] - self._height)
        done = (
            bool((phase == AgentPhase.FLYING).all())
            and self._agents.located(estimate)
            and float(off.max()) <= NEAR
        )
        return TaskOutput(self._goals, status=Status.SUCCESS if done else Status.RUNNING)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        self._agents.keep(rows)
        if self._goals is not None:
            rows_left = self._agents.rows
            top, yaw = self._goals.position[rows_left], self._goals.yaw[rows_left]
            self._goals = self._agents.goals(top, yaw, self._speed)

    def _climb(self, estimate: Estimate) -> TaskOutput:
        rows = self._agents.rows
        top = estimate.position[rows]
        climb = np.maximum(self._height - top[:, 2], 0.0)
        top[:, 2] = self._height
        yaw = estimate.yaw[rows]
        self._goals = self._agents.goals(top, yaw, self._speed)
        duration = np.maximum(climb / self._speed, LEAST_DURATION)
        return TaskOutput(self._goals, (Command(Order.TAKEOFF, rows, top, yaw, duration),))
