"""The verb ``join``: agents in reserve take off and take part in the mission from then on."""

from __future__ import annotations

import math

import numpy as np

from star_core import Estimate, Health, Scene, Status, TaskOutput
from star_verbs.takeoff import Takeoff

CLEAR = 0.5  # m: least horizontal distance of flying agents from one that takes off


class Join(Takeoff):
    """A take-off of agents that are ready: connected, charged, and with no agent above them.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        height: z to climb to, map frame, m.
        speed: Mean speed of the climb, m/s.
        battery: Battery voltage on the ground that each agent needs, V.
    """

    def __init__(
        self, scene: Scene, rows: tuple[int, ...], *, height: float, speed: float, battery: float
    ) -> None:
        super().__init__(scene, rows, height=height, speed=speed)
        self._scene = scene
        self._battery = battery
        self._fit = False

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if not self._fit:
            if why := self._unfit(estimate, health):
                return TaskOutput(status=Status.FAILURE, reason=why)
            self._fit = True
        return super().step(estimate, health)

    def _unfit(self, estimate: Estimate, health: Health) -> str:
        """Return which agents cannot take off, and why; empty if all can."""
        problems = []
        for row in self._agents.rows.tolist():
            name = self._scene.agents[row].name
            volt = float(health.battery[row])
            if math.isnan(volt) or volt < self._battery:
                problems.append(
                    f"the battery of {name} is at {volt:.2f} V, {self._battery:g} V needed"
                )
            near = np.hypot(*(estimate.position - estimate.position[row])[:, :2].T) < CLEAR
            near &= estimate.position[:, 2] > estimate.position[row, 2] + CLEAR
            if near.any():
                above = self._scene.named(np.flatnonzero(near).tolist())
                problems.append(f"{above} is above {name}")
        return "; ".join(problems)
