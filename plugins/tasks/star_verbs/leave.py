"""The verb ``leave``: agents fly home, land, and are not in the mission any more."""

from __future__ import annotations

import numpy as np

from star_core import Estimate, Health, Scene, Status, Step
from star_verbs.approach import Approach
from star_verbs.land import LEAST_DURATION, Land
from star_verbs.timeouts import time_out


class Leave:
    """A flight to where each agent started, at the height it has, and a landing there.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        speed: Greatest speed on the way, m/s; the scene's limit at most, and if None.
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

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._aim(estimate)
        top = self._scene.limits.height[1] / min(self._descent, self._scene.limits.speed)
        return self._approach.time_out(estimate) + time_out(max(top, LEAST_DURATION))

    def step(self, estimate: Estimate, health: Health) -> Step:
        if self._approach.goals is None:
            self._aim(estimate)
        if why := self._approach.fault():
            return Step(status=Status.FAILURE, reason=why)
        self._landing |= self._approach.arrived(estimate)
        if self._landing:
            return self._land.step(estimate, health)
        return Step(self._approach.goals)

    def stay(self, rows: tuple[int, ...]) -> None:
        self._approach.stay(rows)
        self._land.stay(rows)

    def _aim(self, estimate: Estimate) -> None:
        crew = self._approach.crew
        if not crew.located(estimate):
            return
        target = self._home[crew.rows].copy()
        low, high = self._scene.limits.height
        target[:, 2] = np.clip(estimate.position[crew.rows, 2], low, high)
        self._approach.aim(estimate, target)
