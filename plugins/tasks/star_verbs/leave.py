"""The verb ``leave``: agents fly home, land, and leave the mission."""

from __future__ import annotations

import numpy as np

from star_core import Estimate, Health, Scene, Status, TaskOutput, timeout
from star_verbs.approach import Approach
from star_verbs.land import LEAST_DURATION, Land

NEAR_HOME = 0.5  # m
REST = 2.0  # s without `PROGRESS` after which an agent counts as blocked
PROGRESS = 0.02  # m


class Leave:
    """A flight to each agent's start, at its current height, and a landing there.

    Agents that are blocked close to home land where they are: an avoider keeps them from a start
    that is nearer to an obstacle than its clearance.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        speed: Speed limit on the way, m/s; at most the scene's limit, and that if None.
        descent: Mean speed of the descent, m/s.
    """

    def __init__(
        self, scene: Scene, rows: tuple[int, ...], *, speed: float | None, descent: float
    ) -> None:
        self._scene = scene
        self._approach = Approach(scene, rows, speed=speed, yaw_deg=None, within=0.1)
        self._land = Land(scene, rows, speed=descent)
        self._descent = descent
        self._home = np.array([agent.start for agent in scene.agents])
        self._landing = False
        self._nearest = np.inf  # m: least distance from home of the agent farthest from its own
        self._nearer_since = 0.0  # s

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._aim(estimate)
        top = self._scene.limits.height[1] / min(self._descent, self._scene.limits.speed)
        return self._approach.timeout(estimate) + timeout(max(top, LEAST_DURATION))

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if self._approach.goals is None:
            self._aim(estimate)
        if why := self._approach.fault():
            return TaskOutput(status=Status.FAILURE, reason=why)
        self._landing |= self._approach.arrived(estimate) or self._stopped_short(estimate)
        if self._landing:
            return self._land.step(estimate, health)
        return TaskOutput(self._approach.goals)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        self._approach.on_agents_removed(rows)
        self._land.on_agents_removed(rows)

    def _stopped_short(self, estimate: Estimate) -> bool:
        """Whether the agents have made no progress for `REST`, and are close to home."""
        away = self._approach.away(estimate)
        if away < self._nearest - PROGRESS:
            self._nearest, self._nearer_since = away, estimate.time
        return away <= NEAR_HOME and estimate.time - self._nearer_since >= REST

    def _aim(self, estimate: Estimate) -> None:
        agents = self._approach.agents
        if not agents.located(estimate):
            return
        target = self._home[agents.rows].copy()
        low, high = self._scene.limits.height
        target[:, 2] = np.clip(estimate.position[agents.rows, 2], low, high)
        self._approach.aim(estimate, target)
