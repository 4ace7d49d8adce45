"""The planner ``low``."""

import numpy as np

from star_core import Paths, Plan, PositionController, Setpoint


class Low:
    """Flies straight to goals below a height, and refuses the others."""

    def __init__(self, scene, top):
        self._controller = PositionController(scene, gain=1.0, yaw_rate_deg=90.0)
        self._top = top

    def plan(self, estimate, goals):
        unreachable = goals.active & (goals.position[:, 2] > self._top)
        active = goals.active & estimate.valid & ~unreachable
        velocity = self._controller.velocity(estimate, goals)
        yaw = self._controller.heading(estimate, goals, active)
        velocity = np.where(active[:, None], velocity, 0.0)
        paths = Paths(np.zeros(0, np.int64), np.zeros((0, 3)))
        reasons = dict.fromkeys(np.flatnonzero(unreachable).tolist(), "is above the shelf")
        return Plan(Setpoint(velocity, yaw, active), paths, unreachable, reasons)
