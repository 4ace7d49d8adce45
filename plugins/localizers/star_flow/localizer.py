"""Where the agents are if their on-board estimate is right."""

from __future__ import annotations

import numpy as np

from star_core import Estimate, Scene, Telemetry, Transform, wrap_angle
from star_flow.drift import Drift
from star_flow.error import Error
from star_flow.lookout import Lookout


class Flow:
    """Puts each agent's odometry frame where the scene says it stands, and leaves it there.

    A row is valid while the agent was heard no longer than `stale` ago and reports a finite
    position, velocity and attitude. A row that reports none stays where it was last, at rest, so
    that others can still keep clear of it.

    Targets are seen where a camera finds tags on board; they drift with the agent that sees them.
    For studies an error can be added to the positions; the covariance then holds its variance too.

    Args:
        scene: The mission's scene.
        stale: Age past which a report is not flown on, s.
        error: Standard deviation along each axis of the error that is added, m.
        error_time: Time constant with which it is forgotten, s.
        latency: From taking an image to its arrival, for tags that do not say when, s.
    """

    def __init__(
        self, scene: Scene, *, stale: float, error: float, error_time: float, latency: float
    ) -> None:
        self._stale = stale
        self._error = Error(scene, size=error, time_constant=error_time) if error > 0 else None
        self._variance = error**2 * np.eye(3)
        self._map_from_odom = Transform(
            yaw=np.array([agent.yaw for agent in scene.agents]),
            translation=np.array([agent.start for agent in scene.agents]),
        )
        self._reckoned = self._map_from_odom.translation
        self._position = self._reckoned
        self._yaw = self._map_from_odom.yaw
        self._drift = Drift(self._reckoned)
        self._lookout = Lookout(scene, latency=latency)

    def locate(self, telemetry: Telemetry) -> Estimate:
        reckoned = self._map_from_odom.apply(telemetry.position)
        velocity = self._map_from_odom.turn(telemetry.velocity)
        yaw = wrap_angle(telemetry.heading + self._map_from_odom.yaw)
        known = np.isfinite(reckoned.sum(axis=1) + velocity.sum(axis=1) + yaw)
        self._reckoned = np.where(known[:, None], reckoned, self._reckoned)
        if self._error is None:
            self._position = self._reckoned
        else:
            shown = self._reckoned + self._error.at(telemetry.time)
            self._position = np.where(known[:, None], shown, self._position)
        self._yaw = np.where(known, yaw, self._yaw)
        covariance = self._drift.covariance(telemetry.time, self._reckoned) + self._variance
        return Estimate(
            time=telemetry.time,
            position=self._position,
            velocity=np.where(known[:, None], velocity, 0.0),
            yaw=self._yaw,
            covariance=covariance,
            valid=known & (telemetry.age <= self._stale),
            map_from_odom=self._map_from_odom,
            sightings=self._lookout.see(telemetry, self._map_from_odom, self._position, covariance),
        )
