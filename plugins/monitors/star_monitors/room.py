"""How much of their room to obstacles, fence and each other the uncertainty of agents uses up."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Estimate, Mask, Rows, Scene, Transform
from star_core.toolkit import (
    ALONE_SHARE,
    CONTACT_RADIUS,
    LAG,
    MAX_MARGIN_RATIO,
    Pairs,
    Walls,
    compiled,
    nearest_wall,
    walls,
)

WALL_SHARE: Final = 0.5
"""Share of `Limits.uncertainty_margin` that agents need as room to obstacles and fence: by default
one standard deviation. Within the whole margin they still reach goals, slowly."""

FENCE_TOLERANCE: Final = 0.2
"""Distance by which an agent may leave the fence, m: it is no wall."""

MIN_NEED: Final = 0.05  # m; an agent that needs less room to walls always has it
MIN_ROOM: Final = 1e-3  # m, in ratios: an agent in contact has hardly any
COLLISION_DISTANCE: Final = 2 * CONTACT_RADIUS  # m between two agents
PARTING_SPEED: Final = 0.05  # m/s, from which on two agents fly apart
MANY: Final = 64  # agents, from which on it is quicker to search the pairs near each other
CAUTION: Final = 1.001  # factor that covers the rounding by which `measure` may differ


class WallRoom(NamedTuple):
    """How near agents are to the nearest obstacle or side of the fence.

    Attributes:
        use: (N,) room that agents need over the room that they have; 0 if they need hardly any.
        away: (N, 2) unit vectors away from it.
        distance: (N,) to contact with the obstacle, or to the side, m; negative beyond.
        obstacle: (N,) index of the obstacle; -1 is the fence.
    """

    use: Array
    away: Array
    distance: Array
    obstacle: Rows


class PairRoom(NamedTuple):
    """How near agents are to each other.

    Attributes:
        first: (P,) row of one agent of each pair.
        second: (P,) row of the other.
        use: (P,) room that the two need over the room that they have.
        away: (P, 2) unit vectors from the second to the first.
        distance: (P,) between the two in the plane, m.
    """

    first: Rows
    second: Rows
    use: Array
    away: Array
    distance: Array


class Room:
    """Compares the room that agents need for their uncertainty with the room that they have.

    To obstacles and fence, an agent needs `WALL_SHARE` of `Limits.uncertainty_margin` standard
    deviations of its position. Two agents need that number of standard deviations of the distance
    between them, in the plane or in height, when they have braked; `ALONE_SHARE` of it if no others
    are near them. These needs have no limit, as
    the margins have with which agents fly around each other: where these are below their limit,
    they keep enough room.
    """

    def __init__(self, scene: Scene) -> None:
        limits = scene.limits
        self._deviations = limits.uncertainty_margin
        self._limited = limits.separation > 0.0
        self._margin_limit = MAX_MARGIN_RATIO * limits.separation / 2  # m
        self._braking = 2 * LAG * limits.speed  # m, in which two agents that meet stop, at most
        self._fence = np.array([scene.world.fence.low[:2], scene.world.fence.high[:2]], float)
        self._walls = walls(scene.world.obstacles)
        none, nothing, no_agent = np.zeros(0), np.zeros((0, 3)), np.zeros(0, np.bool_)
        now = Estimate(0, nothing, nothing, none, np.zeros((0, 3, 3)), no_agent, Transform.none())
        self.measure(now, none, no_agent, no_agent, 1.0)  # compiled before the flight

    def measure(
        self, estimate: Estimate, std: Array, steered: Mask, airborne: Mask, min_use: float
    ) -> tuple[bool, WallRoom | None]:
        """Return whether surely no agent lacks room, and how near agents are to walls.

        Args:
            estimate: Of the positions.
            std: (N,) standard deviations in the plane, m.
            steered: (N,) agents that need room to walls.
            airborne: (N,) agents that need room to each other.
            min_use: Pairs that use less of their room do not lack it.

        Returns:
            The second is None if all agents need hardly any room to walls.
        """
        tables, n = (estimate.position, estimate.velocity, estimate.covariance), len(std)
        walls = WallRoom(np.empty(n), np.empty((n, 2)), np.empty(n), np.empty(n, np.int64))
        limit = self._margin_limit if self._limited else math.inf
        enough, needs = measure(
            *(*walls, *tables, std, steered, airborne),
            *(self._walls, self._fence, self._deviations, limit, min_use),
        )
        return enough, walls if needs else None

    def between(
        self, estimate: Estimate, std: Array, agents: Mask, min_use: float
    ) -> PairRoom | None:
        """Return how near agents are to each other; None if margins keep enough room.

        Left out are pairs that fly apart, or differ enough in height.

        Args:
            estimate: Of the positions.
            std: (N,) standard deviations in the plane, m.
            agents: (N,) those that are considered.
            min_use: Pairs that use less of their room are left out.
        """
        greatest = np.max(std, initial=0.0, where=agents)
        if not self._limited or self._deviations * greatest <= self._margin_limit:
            return None
        height_std = np.sqrt(np.maximum(estimate.covariance[:, 2, 2], 0.0))
        highest = np.max(height_std, initial=0.0, where=agents)
        most, tall = self._deviations * math.sqrt(2.0) * np.array([greatest, highest])
        most = most / min_use + self._braking
        near = Pairs.of(
            estimate.position, math.hypot(most + COLLISION_DISTANCE, tall + COLLISION_DISTANCE)
        )
        near = near.where(agents[near.first] & agents[near.second])
        first, second = near.first, near.second
        offset = estimate.position[first] - estimate.position[second]
        relative = estimate.velocity[first, :2] - estimate.velocity[second, :2]
        distance = np.hypot(offset[:, 0], offset[:, 1])
        away = offset[:, :2] / np.maximum(distance, MIN_ROOM)[:, None]
        parting = np.vecdot(relative, away)
        room = distance + LAG * np.minimum(parting, 0.0) - COLLISION_DISTANCE
        use = self._needed(std[first], std[second]) / np.maximum(room, MIN_ROOM)
        level = self._needed(height_std[first], height_std[second]) + COLLISION_DISTANCE
        kept = (use > min_use) & (np.abs(offset[:, 2]) < level) & (parting < PARTING_SPEED)
        first, second, use = first[kept], second[kept], use[kept]
        near_each = np.bincount(np.concatenate([first, second]), minlength=len(std))
        alone = (near_each[first] == 1) & (near_each[second] == 1)
        use = np.where(alone, ALONE_SHARE * use, use)
        return PairRoom(first, second, use, away[kept], distance[kept])

    def _needed(self, first: Array, second: Array) -> Array:
        """Return the room that two agents need for their standard deviations, m."""
        return self._deviations * np.hypot(first, second)


@compiled
def measure(  # noqa: C901, PLR0913, PLR0917 -- one pass over all agents, then over pairs
    use: Array,
    away: Array,
    distance: Array,
    obstacle: Rows,
    position: Array,
    velocity: Array,
    covariance: Array,
    std: Array,
    steered: Mask,
    airborne: Mask,
    wall: Walls,
    fence: Array,
    deviations: float,
    margin_limit: float,
    min_use: float,
) -> tuple[bool, bool]:
    """Find the nearest walls, and return whether surely no agent lacks room, as `Room` defines it.

    Args:
        use: (N,) output, as `WallRoom` has them; so are the next three.
        away: (N, 2)
        distance: (N,)
        obstacle: (N,)
        position: (N, 3) m.
        velocity: (N, 3) m/s.
        covariance: (N, 3, 3) of the positions, m².
        std: (N,) standard deviations in the plane, m.
        steered: (N,) agents that need room to walls.
        airborne: (N,) agents that need room to each other.
        wall: The pieces of the obstacles.
        fence: (2, 2) its least and its greatest x and y, m.
        deviations: Number of standard deviations that agents need as room.
        margin_limit: Up to this number of standard deviations, m, margins keep enough room.
        min_use: Pairs that use less of their room do not lack it.

    Returns:
        That, and whether an agent needs more than hardly any room to walls.
    """
    n, enough, uncertain, needs = len(std), True, False, False
    for row in range(n):
        uncertain = uncertain or (airborne[row] and not deviations * std[row] <= margin_limit)
        needed = WALL_SHARE * deviations * std[row] if steered[row] else 0.0
        use[row], obstacle[row] = 0.0, -1
        distance[row], away[row, 0], away[row, 1] = math.inf, 0.0, 0.0
        for side in range(4):  # of the fence: those of least x and y, then the others
            axis, inwards = side % 2, 1.0 if side < 2 else -1.0  # noqa: PLR2004 -- axes
            gap = inwards * (position[row, axis] - fence[side // 2, axis])
            if gap < distance[row]:
                distance[row], away[row, axis], away[row, 1 - axis] = gap, inwards, 0.0
        if not needed > MIN_NEED:
            continue
        needs, room = True, distance[row] + FENCE_TOLERANCE
        apart, piece, x, y = nearest_wall(position, row, wall)
        apart -= CONTACT_RADIUS
        if apart <= room:
            distance[row], away[row, 0], away[row, 1] = apart, x, y
            obstacle[row], room = wall.obstacle[piece], apart
        use[row] = needed / max(room, MIN_ROOM)
        enough = enough and needed * CAUTION < room
    if not uncertain or not enough:
        return enough, needs
    if n >= MANY:
        return False, needs
    for i in range(n):
        for j in range(i):
            if not airborne[i] or not airborne[j]:
                continue
            east, north = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
            apart = math.sqrt(east * east + north * north)
            parting = east * (velocity[i, 0] - velocity[j, 0])
            parting += north * (velocity[i, 1] - velocity[j, 1])
            parting /= max(apart, MIN_ROOM)
            room = apart + LAG * min(parting, 0.0) - COLLISION_DISTANCE
            needed = deviations * math.sqrt(std[i] * std[i] + std[j] * std[j])
            variance = max(covariance[i, 2, 2], 0.0) + max(covariance[j, 2, 2], 0.0)
            height = deviations * math.sqrt(variance)
            close = abs(position[i, 2] - position[j, 2]) < (height + COLLISION_DISTANCE) * CAUTION
            if close and needed * CAUTION > min_use * room and parting < PARTING_SPEED * CAUTION:
                return False, needs
    return True, needs
