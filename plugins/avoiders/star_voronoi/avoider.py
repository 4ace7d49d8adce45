"""The avoider `voronoi`: velocities that stay within buffered Voronoi cells."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core import Array, Estimate, Mask, Scene, Setpoint
from star_core.toolkit import compiled, position_margin, with_possible_positions, yielding_margin

NOTHING = 1e-9  # m or m/s: shorter vectors have no direction
MARGIN = 0.1  # m: an agent nearer than this above or below an obstacle counts as at its height
ROUNDS = 30  # projections onto all borders
BLOCKED = 0.05  # share of the preferred speed: an agent that achieves less turns right
FREE = 0.8  # share of a speed: an agent that achieves less in a direction tries one farther right
HOVERING = 0.05  # m/s: an agent with a lower preferred speed does not make way by itself
ARRIVING = 0.95  # share of the greatest preferred speed since it hovered: a slower one is near
TURNS: Final = np.radians(np.arange(0, 181, 15))  # rad, tried by an agent that follows others
BACK: Final = np.pi / 2  # rad, by which it tries to turn back at a time


class Voronoi:
    """Keeps each agent in the part of the plane that is nearer to it than to any other agent.

    The cell is that of Zhou, Wang, Bandyopadhyay and Schwager, "Fast, On-line Collision Avoidance
    for Dynamic Vehicles Using Buffered Voronoi Cells" (RA-L 2(2), 2017): shrunk by the radius, so
    that agents that stay in their cells do not collide. Cells do not depend on the velocities of
    other agents; the border to an agent that does not avoid is drawn at that agent's circle. An
    agent that others block turns right. Vertically, agents above each other approach ever slower.
    The radius is enlarged for uncertain positions, at most tripled, towards obstacles too.

    An agent that hovering ones block follows them at its left hand, and obstacles beside them,
    until it has turned left as much as right and its way is free: so it leaves pockets between them
    (the algorithm of Pledge; Abelson and diSessa, "Turtle Geometry", 1981). If that leads out of
    the fence or around them, it tries so at its right hand, and then waits. Near its goal it waits.

    The arguments beside the scene are the options of the schema.
    """

    def __init__(self, scene: Scene, *, radius: float, horizon: float) -> None:
        self._radius, self._horizon = radius, horizon
        self._vertical = scene.limits.vertical_separation
        self._uncertainty_margin = scene.limits.uncertainty_margin
        self._speed = scene.limits.speed
        self._reach = self._speed * horizon + radius  # m: farther borders have no effect
        within(np.zeros((1, 3)), np.zeros((1, 1, 2)), np.zeros((1, 1)))  # compile before flight
        pieces = [(p, o.height) for o in scene.world.obstacles for p in o.polygons]
        rows = [(*p[i - 1], *p[i], *height) for p, height in pieces for i in range(len(p))]
        self._edges = np.array(rows, np.float64).reshape(-1, 6)  # both ends, foot and top
        self._fence = np.array([scene.world.fence.low[:2], scene.world.fence.high[:2]])
        self._turned = np.zeros(len(scene.agents))  # rad from the preferred velocity
        self._hand = np.ones(len(scene.agents))  # 1 turns right, -1 left, 0 not at all
        self._course = np.zeros(len(scene.agents))  # rad
        self._wound = np.zeros(len(scene.agents))  # rad that it has turned towards what it follows
        self._cruise = np.zeros(len(scene.agents))  # m/s, greatest preferred speed

    def avoid(self, estimate: Estimate, planned: Setpoint) -> Setpoint:
        n = len(planned.yaw)
        estimate, planned = with_possible_positions(estimate, planned, self._radius)
        avoids = planned.active & estimate.valid
        located = np.asarray(np.isfinite(estimate.position).all(axis=1))
        position = np.where(located[:, None], estimate.position, 0.0)
        wish = np.ascontiguousarray(np.where(avoids[:, None], planned.velocity, 0.0))
        margin = position_margin(estimate.covariance, self._uncertainty_margin, self._radius)
        normal, room = self._agents(position, located, avoids, margin)
        wall, space = self._obstacles(position, margin)
        normal = np.ascontiguousarray(np.concatenate([wall, normal], axis=1))
        most = np.concatenate([space, room], axis=1) / self._horizon
        flat = within(wish, normal, most)
        alone = within(wish, wall, space / self._horizon)
        got, least = (wish[:, :2] * flat).sum(axis=1), BLOCKED * (wish[:, :2] ** 2).sum(axis=1)
        stopped = (got < least) & ((wish[:, :2] * alone).sum(axis=1) > least)  # not by an obstacle
        right = within(np.stack([wish[:, 1], -wish[:, 0]], axis=1), normal, most)
        flat = np.where(stopped[:, None], right, flat)
        pace = np.linalg.norm(wish[:, :2], axis=1)
        hovers = ~avoids | (pace < HOVERING)
        self._cruise = np.where(hovers[:n], 0.0, np.maximum(self._cruise, pace[:n]))
        arrives = hovers[:n] | (pace[:n] < ARRIVING * self._cruise)
        self._turned[arrives], self._hand[arrives] = 0.0, 1.0
        follows = ~arrives & (stopped[:n] | (self._turned > 0)) & (self._hand != 0)
        if follows.any():
            self._lead_around(position, wish, normal, most, follows, hovers, flat)
        velocity = np.column_stack([flat, self._climb(position, located, wish[:, 2])])
        speed = np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), self._speed)
        velocity *= self._speed / speed
        answer = np.where(avoids[:, None], velocity, planned.velocity)
        return Setpoint(answer[:n], planned.yaw[:n], planned.active[:n])

    def _lead_around(
        self,
        position: Array,
        wish: Array,
        normal: Array,
        most: Array,
        follows: Mask,
        hovers: Mask,
        flat: Array,
    ) -> None:
        """Change the velocities of agents that follow hovering ones, (N, 2) m/s, in `flat`."""
        for row in follows.nonzero()[0]:
            if self._turned[row] == 0.0:
                others = most[row : row + 1].copy()
                others[0, -len(hovers) :][hovers] = np.inf
                onward = within(wish[row : row + 1], normal[row : row + 1], others)[0]
                if onward @ wish[row, :2] < BLOCKED * (wish[row, :2] @ wish[row, :2]):
                    continue  # by agents that fly
                self._wound[row] = self._course[row] = 0.0
            turned, hand = max(self._turned[row] - BACK, 0.0) + TURNS, self._hand[row]
            course = np.arctan2(wish[row, 1], wish[row, 0]) - hand * turned
            way = np.column_stack([np.cos(course), np.sin(course)])
            pace, k = np.hypot(wish[row, 0], wish[row, 1]), len(turned)
            tried = within(pace * way, normal[[row] * k], most[[row] * k])
            free = (tried * way).sum(axis=1) > FREE * pace
            first = int(free.argmax())
            end = position[row, :2] + self._horizon * pace * way[first]
            if not free[first]:
                continue
            if self._turned[row] > 0.0:
                change = course[first] - self._course[row]
                self._wound[row] += hand * ((change + np.pi) % (2 * np.pi) - np.pi)
            self._turned[row], self._course[row] = turned[first], course[first]
            flat[row] = tried[first]
            fenced = not ((end > self._fence[0]) & (end < self._fence[1])).all()
            if fenced or self._wound[row] > 2 * np.pi:
                self._turned[row], self._hand[row] = 0.0, min(-hand, 0.0)

    def _agents(
        self, position: Array, located: Mask, avoids: Mask, margin: Array
    ) -> tuple[Array, Array]:
        """Borders to other agents: (N, N, 2) unit vectors towards them and (N, N) room, m."""
        n = len(position)
        towards = position - position[:, None]  # (N, N, 3), from row to column
        distance = np.hypot(towards[..., 0], towards[..., 1])
        direction = towards[..., :2] / np.maximum(distance, NOTHING)[..., None]
        order = np.sign(np.arange(n)[:, None] - np.arange(n))
        direction[..., 0] += (distance <= NOTHING) * order  # the first of two goes forwards
        share = np.where(avoids, 0.5, 1.0)  # of the distance
        room = share * distance - 2 * share * self._radius
        room -= yielding_margin(share * (margin + margin[:, None]), room, self._horizon)
        none = ~located | (np.abs(towards[..., 2]) > self._vertical) | np.eye(n, dtype=bool)
        return direction, np.where(none | (room > self._reach), np.inf, room)

    def _obstacles(self, position: Array, margin: Array) -> tuple[Array, Array]:
        """Borders to edges: (N, E, 2) unit vectors towards their nearest points, (N, E) room, m."""
        a, along = self._edges[:, :2], self._edges[:, 2:4] - self._edges[:, :2]
        from_a = position[:, None, :2] - a  # (N, E, 2)
        squared = np.maximum(np.einsum("ek,ek->e", along, along), NOTHING)
        share = np.clip(np.einsum("nek,ek->ne", from_a, along) / squared, 0.0, 1.0)
        towards = share[..., None] * along - from_a
        distance = np.linalg.norm(towards, axis=2)
        foot, top = self._edges[:, 4] - MARGIN, self._edges[:, 5] + MARGIN
        beside = (position[:, 2:] >= foot) & (position[:, 2:] <= top)
        room = distance - self._radius
        room = room - yielding_margin(margin[:, None], room, self._horizon)
        room = np.where(beside & (distance < self._reach + margin[:, None]), room, np.inf)
        return np.ascontiguousarray(towards / np.maximum(distance, NOTHING)[..., None]), room

    def _climb(self, position: Array, located: Mask, wish: Array) -> Array:
        """(N,) vertical velocity that keeps the distance to agents above and below, m/s."""
        towards = position - position[:, None]
        column = np.hypot(towards[..., 0], towards[..., 1]) < 1.5 * self._radius  # above, below
        column &= located & ~np.eye(len(position), dtype=bool)
        room = np.maximum(np.abs(towards[..., 2]) - self._vertical, 0.0) / (2 * self._horizon)
        up = np.where(column & (towards[..., 2] >= 0), room, np.inf).min(axis=1, initial=np.inf)
        down = np.where(column & (towards[..., 2] <= 0), room, np.inf).min(axis=1, initial=np.inf)
        return np.asarray(np.minimum(np.maximum(wish, -down), up))


@compiled
def within(wish: Array, normal: Array, most: Array) -> Array:
    """Return the velocity within all borders nearest to each preferred one (Dykstra's projections).

    (N, 2) m/s of (N, 2 or 3) m/s; `normal` contains (N, K, 2) unit vectors towards the borders, and
    `most` the (N, K) greatest speeds towards them, m/s.
    """
    answer, corrections = wish[:, :2].copy(), np.zeros_like(most)  # change made by each border
    for i in range(len(most)):
        for _ in range(ROUNDS):
            for k in np.flatnonzero(np.isfinite(most[i])):
                nx, ny = normal[i, k]
                taken = nx * answer[i, 0] + ny * answer[i, 1] + corrections[i, k] - most[i, k]
                taken = max(taken, 0.0)
                answer[i, 0] += (corrections[i, k] - taken) * nx
                answer[i, 1] += (corrections[i, k] - taken) * ny
                corrections[i, k] = taken
    return answer
