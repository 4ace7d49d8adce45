"""Velocities that lead straight to a goal and stop there."""

from __future__ import annotations

import numpy as np

from star_core import Estimate, Goals, Paths, Plan, Scene, Setpoint
from star_core.toolkit import PositionController


class Straight:
    """Flies straight to each goal, as `PositionController` does.

    The arguments beside the scene are the options of the schema.
    """

    def __init__(self, scene: Scene, *, gain: float, yaw_rate_deg: float) -> None:
        self._homing = PositionController(scene, gain=gain, yaw_rate_deg=yaw_rate_deg)

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        active = goals.active & estimate.valid
        velocity = self._homing.velocity(estimate, goals)
        setpoint = Setpoint(
            velocity=np.where(active[:, None], velocity, 0.0),
            yaw=self._homing.heading(estimate, goals, active),
            active=active,
        )
        rows = np.flatnonzero(active)
        ends = np.empty((len(rows), 2, 3))  # from here to the goal
        ends[:, 0] = estimate.position[rows]
        ends[:, 1] = goals.position[rows]
        paths = Paths(agent=rows.repeat(2), point=ends.reshape(-1, 3))
        return Plan(setpoint, paths, unreachable=np.zeros(len(active), np.bool_))
