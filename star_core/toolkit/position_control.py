"""Position control for planners: velocities and headings that lead to points."""

from __future__ import annotations

import math

import numpy as np

from star_core.messages.arrays import Array, Mask, freeze
from star_core.messages.rotations import wrap_angle
from star_core.messages.state import Estimate, Goals, Setpoint
from star_core.toolkit.jit import compiled
from star_core.toolkit.tracking import MAX_LEAD, Tracking
from star_core.world.scene import Scene

BRAKING = 0.5  # of the greatest acceleration: the rest is for wind, avoidance and delay
NOWHERE = 1e-9  # m: nearer than this there is no direction to the goal


class PositionController:
    """Controls each agent's position by its velocity.

    The speed towards a point at distance ``d`` is ``min(speed, gain d, sqrt(2 a d))``: the least of
    the goal's speed, of a proportional controller, and of the speed from which a deceleration ``a``
    of half the scene's limit stops there. The point's own velocity is added, and the sum limited to
    the goal's speed and the scene's. Goals outside the scene's heights are moved to the nearest
    height within, and no vertical speed leads out of them faster than ``gain`` times the distance.

    On the way to a point at rest the height is that of the line to it from where the agent began:
    an agent that sinks on its way, since its on-board controller has not yet learned the thrust
    that it needs, climbs back to the line at once. Sideways it need not return to the line, so that
    agents that avoid each other are not pulled back.

    The heading turns towards the goal's heading the shorter way, no faster than a limit.

    Args:
        scene: The mission's scene.
        gain: Speed towards the point per metre of distance, 1/s.
        yaw_rate_deg: Greatest yaw rate, degrees/s.
    """

    def __init__(self, scene: Scene, *, gain: float, yaw_rate_deg: float) -> None:
        n = len(scene.agents)
        self._limits = scene.limits
        self._gain = gain
        self._tracking = Tracking(n, scene.period)
        self._most_turn = math.radians(yaw_rate_deg) * scene.period
        self._yaw: Array = np.zeros(n)  # last asked for, where `_flown`
        self._flown = np.zeros(n, np.bool_)
        self._begin: Array = np.zeros((n, 3))  # m, where the agents began to fly to the points
        nowhere = Goals.none(n)
        self._point: Array = nowhere.position  # m, of the last tick
        self._under_way: Mask = np.zeros(n, np.bool_)  # likewise
        self._no_more = np.zeros(n)  # m, beyond the points
        self._lead(nowhere.position, nowhere, self._no_more)  # compiled, or fetched, before takeoff

    def velocity(self, estimate: Estimate, goals: Goals, beyond: Array | None = None) -> Array:
        """Return the (N, 3) velocity to fly, m/s.

        Args:
            estimate: Where the agents are.
            goals: The points to fly towards now.
            beyond: (N,) distance behind its point at which each agent stops, along a path, m.
        """
        beyond = self._no_more if beyond is None else beyond
        velocity = self._lead(estimate.position, goals, beyond)
        self._point, self._under_way = goals.position, goals.active & estimate.valid
        return velocity

    def setpoint(
        self, velocity: Array, yaw: Array, active: Mask, estimate: Estimate, goals: Goals
    ) -> Setpoint:
        """Return a setpoint; agents near goals that move along known trajectories follow these.

        Args:
            velocity: (N, 3) of `velocity`, m/s.
            yaw: (N,) of `heading`, rad.
            active: (N,) rows of the setpoint.
            estimate: Where the agents are.
            goals: Goals to which the agents fly straight.
        """
        if goals.acceleration is None:
            self._tracking.forget()
            freeze(velocity, yaw, active)
            return Setpoint(velocity, yaw, active)
        goal = Setpoint(
            velocity, yaw, active & goals.active, goals.position, goals.acceleration, goals.yaw_rate
        )
        away = goals.position - estimate.position
        rows = goal.followed() & (np.vecdot(away, away) <= MAX_LEAD**2)
        tracking = self._within_limits(self._tracking.velocity(estimate, goals, rows), goals.speed)
        low, high = (level - estimate.position[:, 2] for level in self._limits.height)
        down, up = np.minimum(self._gain * low, 0.0), np.maximum(self._gain * high, 0.0)
        tracking[:, 2] = np.clip(tracking[:, 2], down, up)
        velocity = np.where(rows[:, None], tracking, velocity)
        return Setpoint(velocity, yaw, active).following(goal, rows)

    def _within_limits(self, velocity: Array, most: Array) -> Array:
        """Return (N, 3) velocities no faster than (N,) speeds and the scene's limit, m/s."""
        most = np.minimum(most, self._limits.speed)
        speed = np.sqrt(np.vecdot(velocity, velocity))
        slower: Array = velocity * (most / np.maximum(speed, np.maximum(most, NOWHERE)))[:, None]
        return slower

    def _lead(self, position: Array, goals: Goals, beyond: Array) -> Array:
        velocity = np.empty((len(position), 3))
        lead(
            velocity,
            position,
            self._begin,
            self._point,
            self._under_way,
            goals.position,
            goals.velocity,
            goals.speed,
            beyond,
            self._gain,
            self._limits.speed,
            BRAKING * self._limits.acceleration,
            *self._limits.height,
        )
        return velocity

    def heading(self, estimate: Estimate, goals: Goals, active: Mask) -> Array:
        """Return the (N,) yaw of the setpoint, rad; 0 where not `active`.

        It continues from the previous setpoint, not from the agent's yaw: an agent that trails a
        little would otherwise turn slower than the limit.
        """
        start = np.where(self._flown, self._yaw, estimate.yaw)
        error = wrap_angle(goals.yaw - start)
        turned = start + np.minimum(np.maximum(error, -self._most_turn), self._most_turn)
        self._yaw = np.where(active, wrap_angle(turned), 0.0)
        self._flown = active
        return self._yaw


@compiled
def lead(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    velocity: Array,
    position: Array,
    begin: Array,
    last: Array,
    under_way: Mask,
    point: Array,
    moves: Array,
    fast: Array,
    beyond: Array,
    gain: float,
    limit: float,
    brakes: float,
    low: float,
    high: float,
) -> None:
    """Compute velocities that lead to points, as described in `PositionController`.

    Args:
        velocity: (N, 3) the result, m/s.
        position: (N, 3) of the agents, m.
        begin: (N, 3) where they began to fly to the points, m; set where that is now.
        last: (N, 3) the points in the last tick, m.
        under_way: (N,) whether they flew to these.
        point: (N, 3) of the goals, m.
        moves: (N, 3) velocities of the goals, m/s.
        fast: (N,) speeds of the goals, m/s.
        beyond: (N,) distances behind the points to stop at, m.
        gain: Speed by distance, 1/s.
        limit: Of any speed, m/s.
        brakes: Deceleration, m/s².
        low: Least height, m.
        high: Greatest height, m.
    """
    for row in range(len(position)):
        fresh = not under_way[row]
        for axis in range(3):
            fresh = fresh or point[row, axis] != last[row, axis]
        if fresh:
            for axis in range(3):
                begin[row, axis] = position[row, axis]
        x, y = point[row, 0] - position[row, 0], point[row, 1] - position[row, 1]
        height = min(max(point[row, 2], low), high)
        off = _height_error(position[row], begin[row], point[row], height)
        z = height - position[row, 2] - off
        distance = math.sqrt(x * x + y * y + z * z)
        rest = distance + beyond[row]
        closing = min(fast[row], gain * rest, math.sqrt(2 * brakes * rest))
        share = closing / max(distance, NOWHERE)
        x, y = x * share + moves[row, 0], y * share + moves[row, 1]
        climb = min(gain * abs(off), math.sqrt(2 * brakes * abs(off)))
        z = z * share + moves[row, 2] + math.copysign(climb, off)
        speed = math.sqrt(x * x + y * y + z * z)
        most = min(fast[row], limit)
        if speed > most:
            x, y, z = x * most / speed, y * most / speed, z * most / speed
        down, up = gain * (low - position[row, 2]), gain * (high - position[row, 2])
        velocity[row, 0], velocity[row, 1] = x, y
        velocity[row, 2] = min(max(z, min(down, 0.0)), max(up, 0.0))


@compiled
def _height_error(position: Array, begin: Array, point: Array, height: float) -> float:
    """Return by how much an agent is too low, m: below its nearest position on the line to a point.

    Args:
        position: (3,) of the agent, m.
        begin: (3,) of the line, m.
        point: (3,) at its end, m.
        height: That of this end, m.
    """
    east, north, up = point[0] - begin[0], point[1] - begin[1], height - begin[2]
    length = east * east + north * north + up * up
    if length < NOWHERE:
        return 0.0
    x, y, z = position[0] - begin[0], position[1] - begin[1], position[2] - begin[2]
    share = min(max((x * east + y * north + z * up) / length, 0.0), 1.0)
    return float(share * up - z)
