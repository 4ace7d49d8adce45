"""The avoider `potential`: adds the repulsion of near agents and obstacles to the setpoints."""

from __future__ import annotations

import numpy as np

from star_core import Array, Estimate, Mask, Scene, Setpoint
from star_core.toolkit import position_margin, with_possible_positions, yielding_margin

NOTHING = 1e-9  # m or m/s: shorter vectors have no direction
HORIZON = 1.0  # s, in which repulsion stops an approach, about
NEAR_GOAL = 0.4  # m/s: planners are slower than that within a quarter of a metre of a goal
MARGIN = 0.1  # m: an agent nearer than this above or below an obstacle counts as at its height


class Potential:
    """Adds the horizontal repulsion of near agents and obstacles to each preferred velocity.

    The repulsion is the force of Khatib, "Real-Time Obstacle Avoidance for Manipulators and Mobile
    Robots" (IJRR 5(1), 1986), used as a velocity: ``gain (1 / d - 1 / reach) / d²`` away from what
    is at distance ``d < reach`` beyond contact; both agents of a pair are repelled. It is at most
    twice the speed limit, and the resulting velocity is limited to the speed limit. Such fields
    have local minima in which an agent stays: a known property of the method, and the reason for
    the other avoiders. For goals beside obstacles not to be such, the repulsion of obstacles,
    except within the radius, fades with the square of the distance to the goal (Ge and Cui, "New
    potential functions for mobile robot path planning", IEEE Transactions on Robotics and
    Automation 16(5), 2000), which shows in the planner's speed.

    The distance of contact is enlarged for uncertain positions, at most tripled.

    The arguments beside the scene are the options of the schema.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        radius: float,
        reach: float,
        gain: float,
    ) -> None:
        self._radius, self._reach, self._gain = radius, reach, gain
        self._vertical = scene.limits.vertical_separation
        self._uncertainty_margin = scene.limits.uncertainty_margin
        self._speed = scene.limits.speed
        self._height = np.array([thing.height for thing in scene.world.obstacles]).reshape(-1, 2)
        self._edges = [
            np.array(
                [
                    (*a, *b)
                    for polygon in obstacle.polygons
                    for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True)
                ]
            )
            for obstacle in scene.world.obstacles
        ]  # of each obstacle, both ends of its edges, (E, 4) m

    def avoid(self, estimate: Estimate, planned: Setpoint) -> Setpoint:
        n = len(planned.yaw)
        estimate, planned = with_possible_positions(estimate, planned, self._radius)
        pushed = planned.active & estimate.valid
        located = np.asarray(np.isfinite(estimate.position).all(axis=1))
        position = np.where(located[:, None], estimate.position, 0.0)
        margin = position_margin(estimate.covariance, self._uncertainty_margin, self._radius)
        push = self._from_agents(position, located, margin)
        speed = np.hypot(planned.velocity[:, 0], planned.velocity[:, 1])
        away = np.minimum(speed / NEAR_GOAL, 1.0) ** 2
        push += self._from_obstacles(position, margin, away)
        velocity = planned.velocity.copy()
        velocity[:, :2] += np.where(pushed[:, None], push, 0.0)
        answer = np.where(pushed[:, None], self._cut(velocity), velocity)
        return Setpoint(answer[:n], planned.yaw[:n], planned.active[:n])

    def _from_agents(self, position: Array, located: Mask, margin: Array) -> Array:
        """(N, 2) repulsion of other agents, m/s; agents at one point separate along x, by row."""
        n = len(position)
        away = position[:, None] - position  # (N, N, 3), from column to row
        distance = np.hypot(away[..., 0], away[..., 1])
        direction = away[..., :2] / np.maximum(distance, NOTHING)[..., None]
        order = np.sign(np.arange(n) - np.arange(n)[:, None])  # 1 right of the diagonal
        direction[..., 0] += np.where(distance <= NOTHING, order, 0.0)
        room = distance - 2 * self._radius
        distance = distance - yielding_margin(margin + margin[:, None], room, HORIZON)
        near = located & located[:, None] & (np.abs(away[..., 2]) <= self._vertical)
        strength = np.where(near & ~np.eye(n, dtype=bool), self._strength(distance, 2), 0.0)
        return np.asarray(np.einsum("ij,ijk->ik", strength, direction))

    def _from_obstacles(self, position: Array, margin: Array, away_from_goal: Array) -> Array:
        """(N, 2) repulsion of the nearest point of each obstacle at an agent's height, m/s.

        It is multiplied by `away_from_goal`, (N,), beyond the radius.
        """
        offset = np.zeros((len(position), len(self._edges), 2))
        for k, edges in enumerate(self._edges):
            offset[:, k] = _nearest_offset(position[:, :2], edges)
        distance = np.linalg.norm(offset, axis=2)
        room = distance - self._radius
        near = distance - yielding_margin(margin[:, None], room, HORIZON)
        z = position[:, 2:]
        beside = (z >= self._height[:, 0] - MARGIN) & (z <= self._height[:, 1] + MARGIN)
        strength = np.where(beside, self._strength(near, 1), 0.0)
        strength *= np.where(room > 0.0, away_from_goal[:, None], 1.0)
        return np.asarray(
            np.einsum("no,nok->nk", strength, offset / np.maximum(distance, NOTHING)[..., None])
        )

    def _strength(self, distance: Array, radii: int) -> Array:
        """Speed of the repulsion at some distances, m/s; contact is at `radii` times the radius."""
        beyond = np.maximum(distance - radii * self._radius, NOTHING)
        push = self._gain * (1 / beyond - 1 / self._reach) / beyond**2
        return np.asarray(np.clip(push, 0.0, 2 * self._speed))

    def _cut(self, velocity: Array) -> Array:
        """Velocities limited to the speed limit, m/s."""
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        return np.asarray(velocity * np.minimum(1.0, self._speed / np.maximum(speed, NOTHING)))


def _nearest_offset(point: Array, edges: Array) -> Array:
    """Return the (N, 2) vectors to points, (N, 2) m, from the nearest points of (E, 4) edges."""
    a, along = edges[:, :2], edges[:, 2:] - edges[:, :2]
    from_a = point[:, None] - a  # (N, E, 2)
    squared = np.maximum(np.vecdot(along, along), NOTHING)
    share = np.clip(np.vecdot(from_a, along) / squared, 0.0, 1.0)
    offset = from_a - share[..., None] * along
    nearest = np.vecdot(offset, offset).argmin(axis=1)
    return np.asarray(offset[np.arange(len(point)), nearest])
