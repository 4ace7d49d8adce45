"""The verb `nod`: climb and sink again, on the spot."""

from __future__ import annotations

import numpy as np

from star_core import Estimate, Goals, Health, Scene, Status, Step

NEAR = 0.05  # m: nearer to a height than this is there
PATIENCE = 3.0  # times as long as the way takes: agents brake at each end of it
GRACE = 5.0  # s, to settle


class Nod:
    """Sends its agents up and down above where they were when it began.

    Args:
        scene: The mission's scene.
        rows: Rows of its agents.
        height: How far to climb, m.
        times: How often.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], height: float, times: int) -> None:
        self._rows = list(rows)
        self._active = np.isin(np.arange(len(scene.agents)), self._rows)
        self._speed = scene.limits.speed
        self._lifts = [height, 0.0] * times  # m, above where it began: what is still to be reached

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._foot, self._yaw = estimate.position, estimate.yaw
        way = 2 * sum(self._lifts)  # m: up and down again
        return PATIENCE * way / self._speed + GRACE

    def step(self, estimate: Estimate, health: Health) -> Step:
        target = self._foot + np.array([0.0, 0.0, self._lifts[0]])
        away = abs(estimate.position - target)[self._rows, 2]
        if (away < NEAR).all():
            self._lifts.pop(0)
        speed = np.full(len(target), self._speed)
        goals = Goals(target, np.zeros_like(target), self._yaw, speed, self._active)
        return Step(goals, status=Status.RUNNING if self._lifts else Status.SUCCESS)
