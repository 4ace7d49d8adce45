"""The avoider `orca`: passes the swarm's tables to the kernel and back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from star_core import Array, Estimate, Mask, Rows, Scene, Setpoint, Transform
from star_core.toolkit import position_margin, with_possible_positions, yielding_margin
from star_orca.kernel import orca
from star_orca.obstacle_planes import MAX_EDGES, add_obstacles
from star_orca.outlines import Outlines, outlines

# Angle by which agents keep to the right when another is ahead: see `star_orca.keep_right`. It
# deflects a path by at most 5 % of its length (tan(turn) / e: the logarithmic spiral of a steady
# offset).
TURN = math.radians(8.0)
MAX_RETURN = 0.5  # share of the speed limit: fastest required return of an agent outside the fence
_NORMALS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])  # inwards, of the sides
TINY = 1e-12  # m/s
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
            scene's if None. The margin yields: see `star_core.toolkit.yielding_margin`.
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
        self._warm_up(scene)

    def avoid(self, estimate: Estimate, wanted: Setpoint) -> Setpoint:
        n = len(wanted.yaw)
        avoids = wanted.active & estimate.valid
        position, velocity = self._predicted(estimate)
        seen, extended = with_possible_positions(
            replace(estimate, position=position, velocity=velocity), wanted, self._spacing
        )
        more = len(seen.yaw) - n  # possible positions of silent agents
        radius, speed, gives_way = self._radius, self._speed, avoids
        if more:
            radius, speed = (np.append(one, one[:1].repeat(more)) for one in (radius, speed))
            gives_way = np.append(avoids, np.zeros(more, np.bool_))
        here, flown = np.array(seen.position), np.array(seen.velocity)
        result = orca(
            here,
            flown,
            np.array(extended.velocity, order="C"),  # writable and in C order: one set of types
            radius,
            position_margin(seen.covariance, self._uncertainty_margin, self._spacing),
            speed,
            gives_way,
            *hard_planes(
                here,
                flown,
                speed,
                position_margin(seen.covariance, self._uncertainty_margin, self._clearance),
                gives_way,
                self._outlines,
                self._fence,
                horizon=self._obstacle_horizon,
                clearance=self._clearance,
                virtual=self._virtual,
            ),
            self._horizon,
            self._communication_radius,
            self._max_neighbours + more,
            self._vertical,
            self._apart_in,
            TURN,
        )[:n]
        if self._response > 0.0:
            self._limit_acceleration(result, estimate.velocity, avoids)
        self._last_setpoint, self._has_setpoint = result, avoids
        return replace(wanted, velocity=result)

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
        return np.ascontiguousarray(position), np.ascontiguousarray(velocity)

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


def hard_planes(  # noqa: PLR0913 -- what the kernel takes
    position: Array,
    velocity: Array,
    speed: Array,
    margin: Array,
    avoids: Mask,
    outlines: Outlines,
    fence: Array,
    *,
    horizon: float,
    clearance: float,
    virtual: bool = False,
) -> tuple[Array, Rows]:
    """Return each agent's half-planes of the fence and of the obstacles at its height.

    They are hard: not violated for the sake of other agents. The core brakes any agent that would
    cross the fence. An avoider unaware of the fence would evade across it, and rely on space that
    the core does not grant.

    Towards a side of the fence, an agent may fly the speed that reaches it within the horizon;
    beyond a side, it must fly at least the speed that returns it in that time. Sides out of reach
    in that time add no half-plane.

    Args:
        position: (N, 3) m.
        velocity: (N, 3) m/s; agents without a finite velocity are treated as stationary.
        speed: (N,) speed limit, m/s.
        margin: (N,) by which distances are enlarged for an uncertain position, m; it yields.
        avoids: (N,) agents whose half-planes are needed.
        outlines: Of the obstacles.
        fence: (4,) least x and y of the geofence, then greatest, m; may be infinite.
        horizon: Time in which no agent shall hit an obstacle or leave the fence, s.
        clearance: Distance to keep to obstacles, m.
        virtual: Whether obstacles are virtual agents instead of RVO2's half-planes.

    Returns:
        (N, K, 3) half-planes as in `star_orca.half_planes`, and (N,) their numbers.
    """
    rate = 1.0 / horizon
    here = position[:, :2]
    with np.errstate(invalid="ignore"):  # positions and fence may be infinite
        room = np.concatenate([here - fence[:2], fence[2:] - here], axis=1)
        if np.count_nonzero(margin):
            room -= yielding_margin(margin[:, None], room, horizon)
    agent, side = (room < (speed / rate)[:, None]).nonzero()
    count = np.bincount(agent, minlength=len(position))
    planes = np.empty((len(position), len(_NORMALS) + min(len(outlines.edges), MAX_EDGES), 3))
    if len(agent):
        row = np.arange(len(agent)) - np.repeat(np.cumsum(count) - count, count)
        planes[agent, row, :2] = _NORMALS[side]
        returns = np.minimum(-rate * room[agent, side], MAX_RETURN * speed[agent])
        planes[agent, row, 2] = returns
    if len(outlines.edges):
        add_obstacles(
            position,
            velocity,
            speed,
            margin,
            avoids,
            *outlines,
            horizon,
            clearance,
            virtual,
            planes,
            count,
        )
    return planes, count
