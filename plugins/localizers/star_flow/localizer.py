"""Positions by the on-board estimate."""

from __future__ import annotations

import numpy as np

from star_core import Estimate, Scene, Telemetry, Transform
from star_core.toolkit import SurfaceHeights, every, freeze, some, wrap_angle
from star_flow.drift import ArtificialError, drift_of
from star_flow.kernel import follow_moves, warm_up
from star_flow.target_sightings import TargetSightings


class Flow:
    """Keeps each agent's odometry frame at its start.

    A row is valid while its report is no older than `max_report_age` and has a finite position,
    velocity and attitude. A row without them keeps its last position, at rest, so that other agents
    can still avoid it.

    Targets are located where a camera detects tags on board; they drift with the agent that sees
    them. For studies an artificial error can be added to the positions; its variance is part of the
    covariance. The arguments beside the scene are the options of the schema.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        max_report_age: float,
        error_std: float,
        error_time_constant: float,
        latency: float,
    ) -> None:
        self._max_report_age = max_report_age
        self._error = ArtificialError(scene, std=error_std, time_constant=error_time_constant)
        self._variance = error_std**2 * np.eye(3)
        self._map_from_odom = Transform(
            yaw=np.array([agent.yaw for agent in scene.agents]),
            translation=np.array([agent.start for agent in scene.agents]),
        )
        self._reckoned = self._position = self._map_from_odom.translation
        self._yaw = self._map_from_odom.yaw
        self._drift = drift_of(scene, self._reckoned, self._yaw, follow_moves)
        warm_up()
        self._start = self._map_from_odom
        self._surfaces = SurfaceHeights(scene)
        self._offset = np.zeros(len(scene.agents))  # m, added to heights
        self._covariance = np.zeros((len(scene.agents), 3, 3))
        self._targets = TargetSightings(scene, latency=latency)

    def locate(self, telemetry: Telemetry) -> Estimate:
        below = self._surfaces.correct(telemetry, self._position, self._covariance)
        if some(below.offset != self._offset):
            self._offset = below.offset
            translation = self._start.translation.copy()
            translation[:, 2] += below.offset
            self._map_from_odom = Transform(self._start.yaw, translation)
        reckoned = self._map_from_odom.apply(telemetry.position)
        velocity = self._map_from_odom.turn(below.telemetry.velocity)
        yaw = wrap_angle(telemetry.heading + self._map_from_odom.yaw)
        error = self._error.at(telemetry.time)
        valid = telemetry.age <= self._max_report_age
        if all(every(np.isfinite(column)) for column in (reckoned, velocity, yaw)):
            self._reckoned, self._position, self._yaw = reckoned, reckoned + error, yaw
        else:
            finite = np.isfinite(reckoned.sum(axis=1) + velocity.sum(axis=1) + yaw)
            column, valid = finite[:, None], valid & finite
            self._reckoned = np.where(column, reckoned, self._reckoned)
            self._position = np.where(column, self._reckoned + error, self._position)
            self._yaw, velocity = np.where(finite, yaw, self._yaw), np.where(column, velocity, 0.0)
        covariance = self._drift.covariance(telemetry.time, self._reckoned, self._yaw)
        covariance += self._variance
        covariance[:, 2, 2] += below.variance
        self._covariance = covariance
        freeze(self._position, velocity, self._yaw, covariance, valid)
        return Estimate(
            time=telemetry.time,
            position=self._position,
            velocity=velocity,
            yaw=self._yaw,
            covariance=covariance,
            valid=valid,
            map_from_odom=self._map_from_odom,
            sightings=self._targets.locate(
                telemetry, self._map_from_odom, self._position, covariance
            ),
            messages=below.messages,
            heights=below.heights,
        )
