"""Positions by a positioning system, with odometry between its measurements."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Estimate, PoseFixes, Scene, Telemetry, Transform
from star_core.toolkit import wrap_angle, yaw_from_quaternion
from star_positioning.kernel import COLUMNS, HISTORY, STATES, YAW, fuse
from star_positioning.odometry import REPORT_STD, START_STD

START_YAW = math.radians(2.0)  # rad, std of its heading


class Positioning:
    """Fuses measured poses with odometry, in a filter for each agent.

    It begins at the agents' starts. Without measurements the covariance grows by the drift of
    odometry, so a dropout enlarges the distances that agents keep. A row is valid while its report
    is no older than `max_report_age`.

    Args:
        scene: Agents.
        max_report_age: Age up to which a report is valid, s.
    """

    def __init__(self, scene: Scene, *, max_report_age: float) -> None:
        n = len(scene.agents)
        self._max_report_age = max_report_age
        self._state = np.zeros((n, STATES))
        self._state[:, :3] = np.array([agent.start for agent in scene.agents])
        self._state[:, YAW] = [agent.yaw for agent in scene.agents]
        self._covariance = np.zeros((n, STATES, STATES))
        self._covariance[:, range(3), range(3)] = START_STD**2
        self._covariance[:, YAW, YAW] = START_YAW**2
        self._history = np.zeros((n, HISTORY, COLUMNS))
        self._count = np.zeros(n, np.int64)
        self._error = np.zeros((n, 2))
        # The last finite position and yaw in the odometry frame.
        self._reported = np.zeros((n, 3))
        self._heading = np.zeros(n)
        self._fuse(np.full((n, COLUMNS), np.nan), PoseFixes.none())  # compiles, never in flight

    def locate(self, telemetry: Telemetry) -> Estimate:
        heading = telemetry.heading
        finite = np.isfinite(telemetry.position.sum(axis=1) + telemetry.velocity.sum(axis=1))
        finite &= np.isfinite(heading + telemetry.age)
        report = np.column_stack(
            [telemetry.time - telemetry.age, telemetry.position, telemetry.velocity, heading]
        )
        self._fuse(report, telemetry.fixes)
        self._reported = np.where(finite[:, None], telemetry.position, self._reported)
        self._heading = np.where(finite, heading, self._heading)
        turn = wrap_angle(self._state[:, YAW] - self._heading)
        level = Transform(turn, np.zeros_like(self._reported))
        translation = self._state[:, :3] - level.turn(self._reported)
        velocity = np.where(finite[:, None], level.turn(telemetry.velocity), 0.0)
        valid = finite & (telemetry.age <= self._max_report_age)
        late = np.where(valid, telemetry.age, 0.0)
        return Estimate(
            time=telemetry.time,
            position=self._state[:, :3] + late[:, None] * velocity,
            velocity=velocity,
            yaw=wrap_angle(self._state[:, YAW]),
            covariance=self._covariance[:, :3, :3] + REPORT_STD**2 * np.eye(3),
            valid=valid,
            map_from_odom=Transform(turn, translation),
        )

    def _fuse(self, report: Array, fixes: PoseFixes) -> None:
        """Move the filters by (N, COLUMNS) reports and correct them by the fixes."""
        table = np.column_stack(
            [
                fixes.time,
                fixes.position,
                yaw_from_quaternion(fixes.attitude),
                fixes.position_std,
                fixes.attitude_std,
                fixes.correlation_time,
            ]
        )
        good = np.isfinite(table[:, [0, 1, 2, 3, 5]]).all(axis=1)
        order = np.flatnonzero(good)[np.argsort(table[good, 0], kind="stable")]
        fuse(
            self._state,
            self._covariance,
            self._history,
            self._count,
            np.ascontiguousarray(report),
            self._error,
            np.array(fixes.agent[order]),
            np.ascontiguousarray(table[order]),
        )
