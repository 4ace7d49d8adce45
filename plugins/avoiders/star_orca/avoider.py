"""The avoider `orca`: from the swarm's tables to the kernel and back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from star_core import Estimate, Scene, Setpoint, Transform
from star_orca.kernel import orca

# How far agents keep to the right when somebody is ahead. Antipodal circles of 2 to 20 agents that
# meet to the bit all come through from 1 degree on, later the smaller the turn; 3 degrees bow a way
# out by no more than 2 % of its length (tan(turn) / e: the logarithmic spiral of a steady offset).
TURN = math.radians(3.0)


class Orca:
    """Keeps agents apart in the horizontal plane by ORCA; heights and headings pass through.

    Active rows with a valid estimate avoid, each at no more than the scene's greatest speed. All
    other rows are answered as they came; where they are is known, the others give way to them in
    full. The kernel is compiled, or fetched from disk, when the avoider is made: never in flight.

    Args:
        scene: What does not change in flight.
        radius: Half the distance that two agents keep, m.
        horizon: Time for which no two shall collide, s.
        neighbour_distance: How far away neighbours are looked for, m.
        max_neighbours: No more than so many neighbours are looked at, the nearest.
        vertical: Agents further apart in height than this do not avoid each other, m.
    """

    def __init__(
        self,
        scene: Scene,
        radius: float = 0.2,
        horizon: float = 2.0,
        neighbour_distance: float = 4.0,
        max_neighbours: int = 10,
        vertical: float = 0.6,
    ) -> None:
        n = len(scene.agents)
        self._radius = np.full(n, float(radius))
        self._speed = np.full(n, float(scene.limits.speed))
        self._horizon = float(horizon)
        self._neighbour_distance = float(neighbour_distance)
        self._max_neighbours = int(max_neighbours)
        self._vertical = float(vertical)
        self._period = float(scene.period)
        self._warm_up(scene)

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        velocity = orca(
            np.array(estimate.position, order="C"),  # writable and in C order: one set of types
            np.array(estimate.velocity, order="C"),
            np.array(wanted.velocity, order="C"),
            self._radius,
            self._speed,
            wanted.active & estimate.valid,
            self._horizon,
            self._neighbour_distance,
            self._max_neighbours,
            self._vertical,
            self._period,
            TURN,
        )
        return replace(wanted, velocity=velocity)

    def _warm_up(self, scene: Scene) -> None:
        n = len(scene.agents)
        still, level = np.zeros((n, 3)), np.zeros(n)
        start = np.array([agent.start for agent in scene.agents]).reshape(n, 3)
        everybody = np.ones(n, np.bool_)
        odometry = Transform(level, still)
        covariance = np.zeros((n, 3, 3))
        estimate = Estimate(0.0, start, still, level, covariance, everybody, odometry)
        self.avoid(estimate, Setpoint(still, level, everybody))
