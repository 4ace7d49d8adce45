"""The verb ``takeoff``: climb straight up and hold there."""

from __future__ import annotations

import numpy as np

from star_core import AgentPhase, Command, Estimate, Goals, Health, Order, Scene, Status, Step
from star_verbs.crew import Crew
from star_verbs.timeouts import time_out

LEAST_DURATION = 1.0  # s
NEAR = 0.15  # m: off the height is still taken off
IN_THE_AIR = (AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LANDING)


class Takeoff:
    """Has the on-board commanders climb, and gives each agent a goal above where it stood.

    It waits until all its agents are located, and fails at once if one is in the air already.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        height: z to climb to, map frame, m.
        speed: Mean speed of the climb, m/s; the scene's limit at most.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], *, height: float, speed: float) -> None:
        self._crew = Crew(scene, rows)
        self._height = height
        self._speed = min(speed, scene.limits.speed)
        self._goals: Goals | None = None

    def begin(self, estimate: Estimate, health: Health) -> float:
        foot = [agent.start[2] for agent in self._crew.scene.agents]
        return time_out(max(LEAST_DURATION, (self._height - min(foot)) / self._speed))

    def step(self, estimate: Estimate, health: Health) -> Step:
        phase = health.phase[self._crew.rows]
        if self._goals is None:
            flying = self._crew.rows[np.isin(phase, IN_THE_AIR)]
            if len(flying):
                names = self._crew.scene.named(flying.tolist())
                return Step(status=Status.FAILURE, reason=f"already in the air: {names}")
            if not self._crew.located(estimate):
                return Step()
            return self._climb(estimate)
        off = abs(estimate.position[self._crew.rows, 2] - self._height)
        done = (
            bool((phase == AgentPhase.FLYING).all())
            and self._crew.located(estimate)
            and float(off.max()) <= NEAR
        )
        return Step(self._goals, status=Status.SUCCESS if done else Status.RUNNING)

    def stay(self, rows: tuple[int, ...]) -> None:
        self._crew.stay(rows)
        if self._goals is not None:
            rows_left = self._crew.rows
            top, yaw = self._goals.position[rows_left], self._goals.yaw[rows_left]
            self._goals = self._crew.goals(top, yaw, self._speed)

    def _climb(self, estimate: Estimate) -> Step:
        rows = self._crew.rows
        top = estimate.position[rows]
        climb = np.maximum(self._height - top[:, 2], 0.0)
        top[:, 2] = self._height
        yaw = estimate.yaw[rows]
        self._goals = self._crew.goals(top, yaw, self._speed)
        duration = np.maximum(climb / self._speed, LEAST_DURATION)
        return Step(self._goals, (Command(Order.TAKEOFF, rows, top, yaw, duration),))
