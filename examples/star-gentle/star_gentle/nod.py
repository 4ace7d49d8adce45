"""The verb ``nod``."""

import numpy as np

from star_core import Goals, Status, TaskOutput


class Nod:
    def __init__(self, scene, rows, height):  # rows: a tuple of the rows of its agents
        self._rows = list(rows)
        self._height = height
        self._speed = scene.limits.speed

    def begin(self, estimate, health):  # once; returns how long the step may take, s
        self._low = estimate.position.copy()
        self._yaw = estimate.yaw
        self._up = True
        return 20.0

    def step(self, estimate, health):  # every tick, until the status is not RUNNING
        target = self._low + np.array([0, 0, self._height if self._up else 0])
        distance = np.linalg.norm(target - estimate.position, axis=1)[self._rows]
        if distance.max() < 0.05:
            if not self._up:
                return TaskOutput(status=Status.SUCCESS)
            self._up = False
        n = len(self._low)
        active = np.zeros(n, bool)
        active[self._rows] = True  # goals for its own rows only
        return TaskOutput(
            goals=Goals(
                position=target,
                velocity=np.zeros((n, 3)),
                yaw=self._yaw,
                speed=np.full(n, self._speed),
                active=active,
            )
        )
