"""The verbs ``land`` and ``leave``: descend straight down and stop the motors, here or at home."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core import AgentPhase, Array, Command, Estimate, Health, Order, Scene, Status, TaskOutput
from star_core.toolkit import some, timeout
from star_verbs.goto import Approach
from star_verbs.step_agents import StepAgents

MIN_DURATION: Final = 1.0  # s
GROUNDED, LANDED = int(AgentPhase.GROUNDED), int(AgentPhase.LANDED)
TAKING_OFF, FLYING = int(AgentPhase.TAKING_OFF), int(AgentPhase.FLYING)
MAX_HOME_DISTANCE: Final = 0.5  # m from its start at which a blocked agent lands
BLOCKED_TIME: Final = 2.0  # s without `PROGRESS` after which an agent counts as blocked
PROGRESS: Final = 0.02  # m


class Land:
    """Commands the on-board commanders of airborne agents to descend to the floor of the map.

    It does not wait until agents are located: for an agent of unknown height the descent takes as
    long as one from the greatest height.

    The arguments beside scene and rows are the verb's options.
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
        if not some(up):
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

    def _duration(self, estimate: Estimate) -> Array:
        """(K,) time of each agent's descent, s."""
        rows = self._agents.rows
        top = self._agents.scene.limits.height[1]
        height = np.where(estimate.valid[rows], estimate.position[rows, 2], top)
        duration: Array = np.maximum(height / self._speed, MIN_DURATION)
        return duration


class Leave(Approach):
    """A flight to each agent's start, at its current height, and a landing there.

    Agents that are blocked close to home land where they are: an avoider keeps them from a start
    that is nearer to an obstacle than its clearance.

    The arguments beside scene and rows are the verb's options.
    """

    def __init__(
        self, scene: Scene, rows: tuple[int, ...], *, speed: float | None = None, descent: float
    ) -> None:
        super().__init__(scene, rows, speed=speed)
        self._land = Land(scene, rows, speed=descent)
        self._descent = min(descent, scene.limits.speed)
        self._home = np.array([agent.start for agent in scene.agents])
        self._landing = False
        self._nearest = np.inf  # m: least distance from home of the agent farthest from its own
        self._nearer_since = 0.0  # s

    def target(self, position: Array) -> Array:
        home = self._home[self.agents.rows].copy()
        home[:, 2] = np.clip(position[:, 2], *self.agents.scene.limits.height)
        return home

    def begin(self, estimate: Estimate, health: Health) -> float:
        descent = self.agents.scene.limits.height[1] / self._descent
        return super().begin(estimate, health) + timeout(max(descent, MIN_DURATION))

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        output = super().step(estimate, health)
        if output.status is Status.FAILURE:
            return output
        self._landing |= output.status is Status.SUCCESS or self._blocked_near_home(estimate)
        return self._land.step(estimate, health) if self._landing else output

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        super().on_agents_removed(rows)
        self._land.on_agents_removed(rows)

    def _blocked_near_home(self, estimate: Estimate) -> bool:
        """Whether the agents have made no progress for `BLOCKED_TIME`, and are close to home."""
        distance = self.distance(estimate)
        if distance < self._nearest - PROGRESS:
            self._nearest, self._nearer_since = distance, estimate.time
        blocked = estimate.time - self._nearer_since >= BLOCKED_TIME
        return distance <= MAX_HOME_DISTANCE and blocked
