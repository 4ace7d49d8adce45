"""The verb ``join``: agents in reserve take off and are in the mission from then on."""

from __future__ import annotations

import math

import numpy as np

from star_core import Estimate, Health, Scene, Status, Step
from star_verbs.takeoff import Takeoff

CLEAR = 0.5  # m, in the plane: nobody may fly nearer to the place of one that takes off


class Join(Takeoff):
    """A take-off of agents that are fit for it: heard, charged, and with nobody above them.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        height: z to climb to, map frame, m.
        speed: Mean speed of the climb, m/s.
        battery: Voltage on the ground that each needs, V.
    """

    def __init__(
        self, scene: Scene, rows: tuple[int, ...], *, height: float, speed: float, battery: float
    ) -> None:
        super().__init__(scene, rows, height=height, speed=speed)
        self._scene = scene
        self._battery = battery
        self._fit = False

    def step(self, estimate: Estimate, health: Health) -> Step:
        if not self._fit:
            if why := self._unfit(estimate, health):
                return Step(status=Status.FAILURE, reason=why)
            self._fit = True
        return super().step(estimate, health)

    def _unfit(self, estimate: Estimate, health: Health) -> str:
        """Say which agents cannot take off, and why; empty if all can."""
        said = []
        for row in self._crew.rows.tolist():
            name = self._scene.agents[row].name
            volt = float(health.battery[row])
            if math.isnan(volt) or volt < self._battery:
                said.append(f"the battery of {name} is at {volt:.2f} V, {self._battery:g} V needed")
            near = np.hypot(*(estimate.position - estimate.position[row])[:, :2].T) < CLEAR
            near &= estimate.position[:, 2] > estimate.position[row, 2] + CLEAR
            if near.any():
                above = self._scene.named(np.flatnonzero(near).tolist())
                said.append(f"{above} is above {name}")
        return "; ".join(said)
