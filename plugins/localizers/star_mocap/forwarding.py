"""Measured poses for the on-board estimators, and odometry that does not contain them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Array, Corrections, PoseFixes, Scene, Transform
from star_core.toolkit import quaternion_from_euler, wrap_angle, yaw_from_quaternion
from star_mocap.kernel import HEADING, QX, QZ, TIME, VX, VZ

MIN_STD: Final = 0.01  # m, the firmware's default of locSrv.extPosStdDev
MIN_YAW_STD: Final = math.radians(1.0)  # rad
STD_FACTOR: Final = 2.0  # errors of consecutive measurements are not independent, as it assumes


class Forwarding:
    """Sends the newest measurement of each agent, moved on to the time at which it is sent.

    Positions are in the odometry frame that an agent has at its start, so the on-board estimate
    stays in it, and odometry becomes motion in the map. Odometry for the filter is integrated from
    velocities, which the measurements do not change: nothing is counted twice.

    Args:
        scene: Agents.
        rate: Measurements to send to each agent, 1/s.
        turns: Whether attitudes are sent too.
    """

    def __init__(self, scene: Scene, rate: float, *, turns: bool) -> None:
        n = len(scene.agents)
        start = Transform(
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents], float).reshape(n, 3),
        )
        self._to_odometry = start.inverse()
        self._period, self._turns = 1 / rate, turns
        self._sent = np.full(n, -np.inf)  # s
        self._last = np.full((n, 4), np.nan)  # time and velocity of the last report
        self._path = np.zeros((n, 3))  # m, by velocities

    def dead_reckon(self, report: Array) -> None:
        """Replace positions in (N, COLUMNS) reports by integrals of their velocities; in place."""
        now = report[:, [TIME, VX, VX + 1, VZ]]
        passed = now[:, 0] - self._last[:, 0]
        finite = np.isfinite(report[:, HEADING] + now.sum(axis=1))
        new = finite & (passed > 0)
        mean = 0.5 * (now[:, 1:] + self._last[:, 1:])
        self._path[new] += passed[new, None] * mean[new]
        self._last = np.where((new | (finite & np.isnan(passed)))[:, None], now, self._last)
        report[finite, QX : QZ + 1] = self._path[finite]

    def corrections(self, now: float, fixes: PoseFixes, velocity: Array) -> Corrections:
        """Return what is due at `now`, s.

        Args:
            now: s.
            fixes: New measurements, with times, in their order.
            velocity: (N, 3) of the agents in the map, m/s.
        """
        newest = np.full(len(self._sent), -1)
        newest[fixes.agent] = np.arange(len(fixes.agent))  # the last of each
        due = now - self._sent >= self._period - 1e-6
        agent = np.flatnonzero((newest >= 0) & due)
        if not len(agent):
            return Corrections.none()
        self._sent[agent] = now
        rows = newest[agent]
        moved = fixes.position[rows] + (now - fixes.time[rows])[:, None] * velocity[agent]
        frames = self._to_odometry.of(agent)
        yaw = wrap_angle(yaw_from_quaternion(fixes.attitude[rows]) + frames.yaw)
        level = quaternion_from_euler(0 * agent, 0 * agent, np.nan_to_num(yaw))
        turn = np.maximum(MIN_YAW_STD, STD_FACTOR * fixes.attitude_std[rows])
        return Corrections(
            agent=agent,
            position=frames.apply(moved),
            attitude=level,
            position_deviation=np.maximum(MIN_STD, STD_FACTOR * fixes.position_std[rows]),
            attitude_deviation=np.where(np.isfinite(yaw) & self._turns, turn, np.inf),
        )
