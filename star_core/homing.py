"""Velocities and headings that lead to points and come to rest there: what planners share."""

from __future__ import annotations

import math

import numpy as np

from star_core.scene import Scene
from star_core.swarm import Estimate, Goals
from star_core.table import Array, Mask

BRAKING = 0.5  # of the greatest acceleration: the rest is for wind, avoidance and delay
NOWHERE = 1e-9  # m: nearer than this there is no direction to the goal


class Homing:
    """Flies each agent towards a point, at the speed of a point that moves and what closes in.

    Towards a point at distance ``d`` the speed is ``min(speed, gain d, sqrt(2 a d))``: that of the
    goal, or what a proportional controller says, or what a deceleration ``a`` of half the scene's
    greatest brings to rest there, whichever is least. The point's own velocity is added, and the
    sum shortened to the goal's speed and the scene's. A point beyond the scene's heights is flown
    to at the nearest height within, and no vertical speed leads out of them faster than ``gain``
    times what is left.

    The heading turns from where the agent looks to the goal's heading the shorter way round, no
    faster than a limit.

    Args:
        scene: The mission's scene.
        gain: Speed towards the point per metre of distance, 1/s.
        yaw_rate_deg: Greatest yaw rate, degrees/s.
    """

    def __init__(self, scene: Scene, *, gain: float, yaw_rate_deg: float) -> None:
        n = len(scene.agents)
        self._limits = scene.limits
        self._gain = gain
        self._most_turn = math.radians(yaw_rate_deg) * scene.period
        self._yaw: Array = np.zeros(n)  # last asked for, where `_flown`
        self._flown = np.zeros(n, np.bool_)

    def velocity(self, estimate: Estimate, goals: Goals, beyond: Array | float = 0.0) -> Array:
        """Return the (N, 3) velocity to fly, m/s.

        Args:
            estimate: Where the agents are.
            goals: The points to fly towards now.
            beyond: (N,) how far behind its point each agent is to come to rest, along a path, m.
        """
        low, high = self._limits.height
        height = estimate.position[:, 2]
        offset = goals.position - estimate.position
        within = np.minimum(np.maximum(goals.position[:, 2], low), high)
        np.subtract(within, height, out=offset[:, 2])
        distance = np.sqrt(np.einsum("ij,ij->i", offset, offset))
        rest = distance + beyond
        braking = np.sqrt(2 * BRAKING * self._limits.acceleration * rest)
        closing = np.minimum(np.minimum(goals.speed, self._gain * rest), braking)
        offset *= (closing / np.maximum(distance, NOWHERE))[:, None]
        velocity: Array = offset + goals.velocity
        most = np.minimum(goals.speed, self._limits.speed)
        speed = np.sqrt(np.einsum("ij,ij->i", velocity, velocity))
        if (speed > most).any():
            velocity *= np.minimum(1.0, most / np.maximum(speed, NOWHERE))[:, None]
        down, up = self._gain * (low - height), self._gain * (high - height)
        upward = velocity[:, 2]
        upward[:] = np.minimum(np.maximum(upward, np.minimum(down, 0.0)), np.maximum(up, 0.0))
        return velocity

    def heading(self, estimate: Estimate, goals: Goals, active: Mask) -> Array:
        """Return the (N,) yaw to ask for, rad; 0 where not `active`.

        It goes on from what was asked for last, not from where the agent looks: an agent that
        always trails a little would else turn slower than the limit.
        """
        start = np.where(self._flown, self._yaw, estimate.yaw)
        error = (goals.yaw - start + math.pi) % math.tau - math.pi
        turned = start + np.minimum(np.maximum(error, -self._most_turn), self._most_turn)
        turned = (turned + math.pi) % math.tau - math.pi
        self._yaw = np.where(active, turned, 0.0)
        self._flown = active
        return self._yaw
