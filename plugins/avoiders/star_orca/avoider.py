"""The avoider `orca`: passes the swarm's tables to the kernel and back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from star_core import Array, Estimate, Goals, Mask, Scene, Setpoint, Transform
from star_core.toolkit import frozen, position_margin, some, with_possible_positions
from star_orca.kernel import orca
from star_orca.outlines import outlines

# Angle by which agents keep to the right when another is ahead: see `star_orca.keep_right`. It
# deflects a path by at most 5 % of its length (tan(turn) / e: the logarithmic spiral of a steady
# offset).
TURN = math.radians(8.0)
ROUNDING = 1e-6  # m/s, within which a velocity that needs no correction is returned
TINY = 1e-12  # m/s
AT_GOAL = 0.3  # m: a nearer agent is where it is to stay
REMAINING = math.exp(-1.0)  # share of a difference that remains after one time constant


class Orca:
    """Keeps agents apart in the horizontal plane by ORCA; headings pass through.

    Active rows with a valid estimate avoid, each within the scene's speed limit. All other rows are
    returned unchanged; if their positions are known, the other agents give way to them in full.
    Obstacles are avoided by agents at their height, or less than 10 cm above or below them, and no
    agent evades across the fence. The kernel is compiled, or loaded from the cache on disk, when
    the avoider is created: never in flight.

    Args:
        scene: Static description of the flight.
        radius: Half the horizontal distance to keep between two agents, m.
        horizon: Time for which no two agents shall collide, s.
        communication_radius: Horizontal distance within which agents are neighbours, m.
        max_neighbours: Greatest number of neighbours avoided, the nearest.
        obstacles: How the world's obstacles are avoided: as ``half-planes``, as
            ``virtual-agents``, or not at all (``none``).
        obstacle_horizon: Time for which no agent shall collide with an obstacle, s.
        clearance: Distance to keep to obstacles, m; the radius if None.
        response: Time constant with which agents follow a velocity, s. Collisions are predicted
            from the positions that much later, two overlapping agents take at least that long to
            separate, and setpoints respect the scene's horizontal acceleration limit.
        uncertainty_margin: Number of standard deviations of its position by which an agent's radius
            is enlarged, at most tripled, and so are the distances to obstacles and fence; the
            scene's if None. The margin yields: see `star_core.toolkit.yielding_margin`; slowly, if
            it is wide, the agents fly to goals that are not near each other, and there are no
            obstacles.
    """

    def __init__(  # noqa: PLR0913 -- one for each option
        self,
        scene: Scene,
        *,
        radius: float,
        horizon: float,
        communication_radius: float,
        max_neighbours: int,
        obstacles: str,
        obstacle_horizon: float,
        clearance: float | None,
        response: float,
        uncertainty_margin: float | None,
    ) -> None:
        n = len(scene.agents)
        self._radius = np.full(n, float(radius))
        self._spacing = float(radius)  # m, between possible positions of a silent agent
        margin = (
            scene.limits.uncertainty_margin if uncertainty_margin is None else uncertainty_margin
        )
        self._uncertainty_margin = float(margin)
        self._speed = np.full(n, float(scene.limits.speed))
        self._horizon = float(horizon)
        self._communication_radius = float(communication_radius)
        self._max_neighbours = int(max_neighbours)
        self._vertical = float(scene.limits.vertical_separation)
        self._apart_in = max(float(scene.period), float(response))
        self._response = float(response)
        self._change = float(scene.limits.acceleration) * self._response  # m/s
        self._last_setpoint = np.zeros((n, 3))  # m/s, where `_has_setpoint`
        self._has_setpoint = np.zeros(n, np.bool_)
        self._obstacle_horizon = float(obstacle_horizon)
        self._clearance = float(radius if clearance is None else clearance)
        self._virtual = obstacles == "virtual-agents"
        world = replace(scene.world, obstacles=()) if obstacles == "none" else scene.world
        self._outlines = outlines(world)
        low, high = scene.world.fence.low, scene.world.fence.high
        self._fence = np.array([*low[:2], *high[:2]], float)
        self._goals = Goals.none(n)
        self._warm_up(scene)

    def note_goals(self, goals: Goals) -> None:
        self._goals = goals

    def avoid(self, estimate: Estimate, planned: Setpoint) -> Setpoint:
        n = len(planned.yaw)
        avoids = planned.active & estimate.valid
        position, velocity = self._predicted(estimate)
        covariance, wish = estimate.covariance, np.array(planned.velocity)
        radius, speed, gives_way, more = self._radius, self._speed, avoids, 0
        if np.count_nonzero(estimate.possible_travel):
            extended_estimate, extended = with_possible_positions(
                replace(estimate, position=position, velocity=velocity), planned, self._spacing
            )
            more = len(extended_estimate.yaw) - n  # possible positions of silent agents
            radius, speed = (
                np.append(column, column[:1].repeat(more)) for column in (radius, speed)
            )
            gives_way = np.append(avoids, np.zeros(more, np.bool_))
            position, velocity = (
                np.array(extended_estimate.position),
                np.array(extended_estimate.velocity),
            )
            covariance, wish = extended_estimate.covariance, np.array(extended.velocity)
        deviations, obstacles = self._uncertainty_margin, self._outlines

        def solved(turn: float) -> Array:
            return orca(  # arrays are writable and in C order: one set of types
                position,
                velocity,
                wish,
                radius,
                position_margin(covariance, deviations, self._spacing),
                speed,
                gives_way,
                self._distant_goals(position, avoids),
                position_margin(covariance, deviations, self._clearance),
                self._fence,
                obstacles.edges if len(obstacles.edges) else None,
                obstacles.first,
                obstacles.height,
                self._obstacle_horizon,
                self._clearance,
                self._virtual,
                self._horizon,
                self._communication_radius,
                self._max_neighbours + more,
                self._vertical,
                self._apart_in,
                turn,
            )[:n]

        result = solved(TURN)
        if more:
            result = result.copy()
        if self._response > 0.0:
            self._limit_acceleration(result, estimate.velocity, avoids)
        followed = planned.followed()
        if some(followed):  # the rule of the road turns agents that need not avoid
            free = np.abs(solved(0.0) - wish[:n]).max(axis=1) <= ROUNDING
            keep = followed & free
            result[keep] = planned.velocity[keep]
        self._last_setpoint, self._has_setpoint = result, avoids
        return Setpoint(frozen(result), planned.yaw, planned.active)

    def _distant_goals(self, position: Array, avoids: Mask) -> Array:
        """Return where agents at (M, 3) m fly, (M, 2) m; NaN where they are, or have no goal."""
        goal, n = np.full((len(position), 2), np.nan), len(avoids)
        way = self._goals.position[:, :2] - position[:n, :2]
        flies = avoids & self._goals.active & (np.hypot(way[:, 0], way[:, 1]) > AT_GOAL)
        goal[:n][flies] = self._goals.position[flies, :2]
        return goal

    def _limit_acceleration(self, answer: Array, flown: Array, avoids: Mask) -> None:
        """Bring horizontal velocities to within the greatest change of the current ones, in place.

        A drone that follows a velocity as a first-order lag accelerates by the difference over its
        time constant. Agents above their speed limit are still not commanded a higher speed than
        it. A current velocity that is not finite imposes no limit.
        """
        now = flown[:, :2]
        change = answer[:, :2] - now
        size = np.hypot(change[:, 0], change[:, 1])
        rows = (avoids & (size > self._change)).nonzero()[0]
        if len(rows):
            reached = now[rows] + (self._change / size[rows])[:, None] * change[rows]
            speed = np.hypot(reached[:, 0], reached[:, 1])
            share = np.minimum(1.0, self._speed[rows] / np.maximum(speed, TINY))
            answer[rows, :2] = share[:, None] * reached

    def _predicted(self, estimate: Estimate) -> tuple[Array, Array]:
        """Return positions and velocities one response time ahead, (N, 3) m and m/s each.

        Until then an agent follows its previous setpoint rather than the current one: its velocity
        approaches it as a first-order lag. An agent without a setpoint keeps its velocity.
        """
        position, velocity = np.array(estimate.position), np.array(estimate.velocity)
        if self._response > 0.0:
            target = np.where(self._has_setpoint[:, None], self._last_setpoint, velocity)
            missing = velocity - target
            position += self._response * (target + (1 - REMAINING) * missing)
            velocity = target + REMAINING * missing
        return position, velocity

    def _warm_up(self, scene: Scene) -> None:
        n = len(scene.agents)
        still, level = np.zeros((n, 3)), np.zeros(n)
        start = np.array([agent.start for agent in scene.agents]).reshape(n, 3)
        every_row = np.ones(n, np.bool_)
        odometry = Transform(level, still)
        covariance = np.zeros((n, 3, 3))
        estimate = Estimate(0.0, start, still, level, covariance, every_row, odometry)
        self.avoid(estimate, Setpoint(still, level, every_row))
        self._has_setpoint = np.zeros(n, np.bool_)
