"""Velocities that lead straight to a goal and stop there."""

from __future__ import annotations

import numpy as np

from star_core import Estimate, Goals, Paths, Plan, Scene
from star_core.toolkit import PositionController, freeze


class Straight:
    """Flies straight to each goal, as `PositionController` does.

    The arguments beside the scene are the options of the schema.
    """

    def __init__(self, scene: Scene, *, gain: float, yaw_rate_deg: float) -> None:
        self._homing = PositionController(scene, gain=gain, yaw_rate_deg=yaw_rate_deg)

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        active = goals.active & estimate.valid
        velocity = self._homing.velocity(estimate, goals)
        yaw = self._homing.heading(estimate, goals, active)
        rows = active.nonzero()[0]
        if len(rows) < len(active):
            velocity[~active] = 0.0
        ends = np.empty((2 * len(rows), 3))  # from here to the goal
        ends[::2] = estimate.position[rows]
        ends[1::2] = goals.position[rows]
        agent, unreachable = rows.repeat(2), np.zeros(len(active), np.bool_)
        freeze(agent, ends, unreachable)
        return Plan(
            self._homing.setpoint(velocity, yaw, active, estimate, goals),
            Paths(agent=agent, point=ends),
            unreachable=unreachable,
        )
