"""Steering: the velocities at which agents of a rehearsal fly to their goals."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from star_core import Array, Estimate, Goals, Mask, Mission, Registry
from star_core.testing import straight_velocity
from star_core.toolkit import PluginGuard, wrap_angle
from star_explain.passing import Passing
from star_explain.separation import option
from star_explain.uncertainty import Uncertainty

GAIN: Final = 1.5  # 1/s, of a planner without this option
YAW_RATE_DEG: Final = 90.0  # degrees/s, likewise
BRAKING: Final = 0.5  # of the greatest acceleration, as `PositionController`


class Steering:
    """Leads agents straight to their goals, and lets them give way to each other.

    In a world with obstacles, planner and avoider of the mission do both if they lead around these:
    which way agents take, and at which corner one waits for another, follows from nothing simpler.
    They import numba, which a rehearsal without obstacles does not. Agents fly straight to goals
    that the planner refuses, and to all once a plugin has failed: the checks report these.
    """

    def __init__(self, mission: Mission, registry: Registry) -> None:
        self._scene = scene = mission.scene
        self._gain = option(mission, "planner", "gain", GAIN)
        yaw_rate_deg = option(mission, "planner", "yaw_rate_deg", YAW_RATE_DEG)
        self._most_turn = math.radians(yaw_rate_deg) * scene.period
        self._uncertainty = Uncertainty(mission, registry)
        self._passing = Passing(mission, self._uncertainty.std)
        self._plugins = None
        used = {kind: mission.plugins[kind] for kind in ("planner", "avoider")}
        specs = {kind: registry.find(kind, used[kind].use).offer for kind in used}
        if (scene.world.obstacles or scene.world.virtual) and specs["planner"].avoids_obstacles:
            made = []
            for kind, choice in used.items():
                with PluginGuard(str(choice)):
                    made.append(specs[kind].make(scene, **choice.options))
            self._plugins = tuple(made)

    def heading(self, estimate: Estimate, goals: Goals) -> Array:
        """Return the headings of all agents, which turn to their goals', (N,) rad."""
        error = wrap_angle(goals.yaw - estimate.yaw)
        turned: Array = estimate.yaw + np.clip(error, -self._most_turn, self._most_turn)
        return turned

    def velocity(self, estimate: Estimate, goals: Goals, steered: Mask) -> Array:
        """Return the velocities of all agents, (N, 3) m/s.

        Args:
            estimate: Of the agents.
            goals: Of the agents.
            steered: (N,) agents that fly to their goals.
        """
        now = estimate.time
        self._uncertainty.add(now, estimate.position, estimate.yaw)
        velocity = straight_velocity(
            estimate.position,
            goals,
            self._scene.period,
            gain=self._gain,
            braking=BRAKING * self._scene.limits.acceleration,
            limit=self._scene.limits.speed,
        )
        if self._plugins is not None:
            planner, avoider = self._plugins
            variance = self._uncertainty.std()[:, None, None] ** 2
            estimate = replace(estimate, covariance=variance * np.eye(3))
            try:
                plan = planner.plan(estimate, replace(goals, active=goals.active & steered))
                planned = np.where(plan.unreachable[:, None], velocity, plan.setpoint.velocity)
                setpoint = replace(plan.setpoint, velocity=planned)
                return np.array(avoider.avoid(estimate, setpoint).velocity)
            except KeyboardInterrupt:
                raise
            except BaseException:  # noqa: BLE001 -- whatever a plugin may raise, as the flight reports
                self._plugins = None
        return self._passing.velocity(now, estimate.position, goals, steered, velocity)
