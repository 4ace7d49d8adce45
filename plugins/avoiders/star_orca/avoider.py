"""The avoider `orca`: from the swarm's tables to the kernel and back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from star_core import Array, Estimate, Scene, Setpoint, Transform
from star_orca.doubt import doubt
from star_orca.kernel import orca
from star_orca.outlines import outlines
from star_orca.reach import within_reach

# How far agents keep to the right when somebody is ahead: see `star_orca.keep_right`. It bows a way
# out by no more than 5 % of its length (tan(turn) / e: the logarithmic spiral of a steady offset).
TURN = math.radians(8.0)
LEFT = math.exp(-1.0)  # of a difference is left after one time constant


class Orca:
    """Keeps agents apart in the horizontal plane by ORCA; headings pass through.

    Active rows with a valid estimate avoid, each at no more than the scene's greatest speed. All
    other rows are answered as they came; where they are is known, the others give way to them in
    full. Obstacles are avoided by agents at their height, or less than 10 cm over or under them,
    and nobody makes room by leaving the fence.
    The kernel is compiled, or fetched from disk, when the avoider is made: never in flight.

    Args:
        scene: What does not change in flight.
        radius: Half the distance that two agents keep, m.
        horizon: Time for which no two shall collide, s.
        communication_radius: How far away neighbours are looked for, m.
        max_neighbours: No more than so many neighbours are looked at, the nearest.
        vertical: Agents further apart in height than this do not avoid each other, m.
        obstacles: How the world's obstacles are avoided: as ``half-planes``, as
            ``virtual-agents``, or not at all (``none``).
        obstacle_horizon: Time for which none shall collide with an obstacle, s.
        clearance: Distance that each keeps to obstacles, m; the radius if None.
        response: Time constant with which agents follow a velocity, s. Everything is worked out for
            where they will be that much later, two that overlap take no less to come apart, and
            nobody is asked for more than the scene's greatest acceleration in the plane.
        deviations: By how many standard deviations of its place an agent's radius is larger, but
            no more than doubled.
    """

    def __init__(  # noqa: PLR0913 -- one for every option
        self,
        scene: Scene,
        *,
        radius: float = 0.2,
        horizon: float = 2.0,
        communication_radius: float = 4.0,
        max_neighbours: int = 10,
        vertical: float = 0.6,
        obstacles: str = "half-planes",
        obstacle_horizon: float = 1.0,
        clearance: float | None = None,
        response: float = 0.3,
        deviations: float = 0.0,
    ) -> None:
        n = len(scene.agents)
        self._radius = np.full(n, float(radius))
        self._deviations = float(deviations)
        self._speed = np.full(n, float(scene.limits.speed))
        self._horizon = float(horizon)
        self._communication_radius = float(communication_radius)
        self._max_neighbours = int(max_neighbours)
        self._vertical = float(vertical)
        self._apart_in = max(float(scene.period), float(response))
        self._response = float(response)
        self._change = float(scene.limits.acceleration) * self._response
        self._flown = np.zeros((n, 3))  # what was last answered, where `_flies`
        self._flies = np.zeros(n, np.bool_)
        self._obstacle_horizon = float(obstacle_horizon)
        self._clearance = float(radius if clearance is None else clearance)
        self._virtual = obstacles == "virtual-agents"
        world = replace(scene.world, obstacles=()) if obstacles == "none" else scene.world
        self._outlines = outlines(world)
        low, high = scene.world.fence.low, scene.world.fence.high
        self._fence = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        self._warm_up(scene)

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        avoids = wanted.active & estimate.valid
        position, velocity = self._soon(estimate)
        answer = orca(
            position,
            velocity,
            np.array(wanted.velocity, order="C"),  # writable and in C order: one set of types
            self._radius + doubt(estimate.covariance, self._deviations, self._radius),
            self._speed,
            avoids,
            *self._outlines,
            self._fence,
            self._horizon,
            self._obstacle_horizon,
            self._clearance,
            self._virtual,
            self._communication_radius,
            self._max_neighbours,
            self._vertical,
            self._apart_in,
            TURN,
        )
        if self._response > 0.0:
            within_reach(answer, np.array(estimate.velocity), avoids, self._change, self._speed)
        self._flown, self._flies = answer, avoids
        return replace(wanted, velocity=answer)

    def _soon(self, estimate: Estimate) -> tuple[Array, Array]:
        """Return positions and velocities one time of response ahead, (N, 3) m and m/s each.

        Until then an agent flies what it was last told rather than what it is told now: it nears
        that velocity as a lag of first order does. One that was told nothing flies on as it does.
        """
        position, velocity = np.array(estimate.position), np.array(estimate.velocity)
        if self._response > 0.0:
            told = np.where(self._flies[:, None], self._flown, velocity)
            missing = velocity - told
            position += self._response * (told + (1 - LEFT) * missing)
            velocity = told + LEFT * missing
        return np.ascontiguousarray(position), np.ascontiguousarray(velocity)

    def _warm_up(self, scene: Scene) -> None:
        n = len(scene.agents)
        still, level = np.zeros((n, 3)), np.zeros(n)
        start = np.array([agent.start for agent in scene.agents]).reshape(n, 3)
        everybody = np.ones(n, np.bool_)
        odometry = Transform(level, still)
        covariance = np.zeros((n, 3, 3))
        estimate = Estimate(0.0, start, still, level, covariance, everybody, odometry)
        self.avoid(estimate, Setpoint(still, level, everybody))
        self._flies = np.zeros(n, np.bool_)
