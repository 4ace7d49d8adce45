"""Velocities that lead straight to a goal and come to rest there."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Estimate, Goals, Mask, Paths, Plan, Scene, Setpoint

BRAKING = 0.5  # of the greatest acceleration: the rest is for wind, avoidance and delay
NOWHERE = 1e-9  # m: nearer than this there is no direction to the goal


class Straight:
    """Flies straight to each goal, at the speed of a goal that moves and what closes the distance.

    Towards a goal at distance ``d`` the speed is ``min(speed, gain d, sqrt(2 a d))``: that of the
    goal, or what a proportional controller says, or what a deceleration ``a`` of half the scene's
    greatest brings to rest at the goal, whichever is least. The goal's own velocity is added, and
    the sum shortened to the goal's speed and the scene's. A goal beyond the scene's heights is
    flown to at the nearest height within, and no vertical speed leads out of them faster than
    ``gain`` times what is left.

    The heading turns from where the agent looks to the goal's heading the shorter way round, no
    faster than a limit.

    Args:
        scene: The mission's scene.
        gain: Speed towards the goal per metre of distance, 1/s.
        yaw_rate_deg: Greatest yaw rate, degrees/s.
    """

    def __init__(self, scene: Scene, *, gain: float, yaw_rate_deg: float) -> None:
        n = len(scene.agents)
        self._limits = scene.limits
        self._gain = gain
        self._most_turn = math.radians(yaw_rate_deg) * scene.period
        self._yaw: Array = np.zeros(n)  # last asked for, where `_flown`
        self._flown = np.zeros(n, np.bool_)

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        active = goals.active & estimate.valid
        setpoint = Setpoint(
            velocity=np.where(active[:, None], self._velocity(estimate, goals), 0.0),
            yaw=self._turn(estimate, goals, active),
            active=active,
        )
        rows = np.flatnonzero(active)
        ends = np.empty((len(rows), 2, 3))  # from here to the goal
        ends[:, 0] = estimate.position[rows]
        ends[:, 1] = goals.position[rows]
        paths = Paths(agent=rows.repeat(2), point=ends.reshape(-1, 3))
        return Plan(setpoint, paths, unreachable=np.zeros(len(active), np.bool_))

    def _velocity(self, estimate: Estimate, goals: Goals) -> Array:
        """(N, 3) velocity to fly, m/s."""
        low, high = self._limits.height
        here = estimate.position
        offset = goals.position - here
        offset[:, 2] = np.minimum(np.maximum(goals.position[:, 2], low), high) - here[:, 2]
        distance = np.sqrt(np.einsum("ij,ij->i", offset, offset))
        braking = np.sqrt(2 * BRAKING * self._limits.acceleration * distance)
        closing = np.minimum(np.minimum(goals.speed, self._gain * distance), braking)
        velocity: Array = (
            goals.velocity + offset * (closing / np.maximum(distance, NOWHERE))[:, None]
        )
        most = np.minimum(goals.speed, self._limits.speed)
        speed = np.sqrt(np.einsum("ij,ij->i", velocity, velocity))
        velocity *= np.minimum(1.0, most / np.maximum(speed, NOWHERE))[:, None]
        down = np.minimum(self._gain * (low - here[:, 2]), 0.0)
        up = np.maximum(self._gain * (high - here[:, 2]), 0.0)
        velocity[:, 2] = np.minimum(np.maximum(velocity[:, 2], down), up)
        return velocity

    def _turn(self, estimate: Estimate, goals: Goals, active: Mask) -> Array:
        """(N,) yaw to ask for, rad.

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
