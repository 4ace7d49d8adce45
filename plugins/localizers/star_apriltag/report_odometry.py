"""Odometry of agents that stream none, from what they report in each tick."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core import Odometry, Telemetry, Transform, wrap_angle

SILENT: Final = 0.5  # s without a sample, after which reports stand in for the stream
LEAST: Final = 1e-6  # s between two reports: less is one report, told twice


class Reports:
    """Completes the odometry stream.

    Args:
        agents: How many there are.

    Attributes:
        silent: Rows of those for whom reports stood in last.
    """

    def __init__(self, agents: int) -> None:
        self.silent: set[int] = set()
        self._streamed = np.full(agents, -np.inf)  # s, when there was a sample last
        self._time = np.full(agents, np.nan)  # s, of the last report with a heading
        self._heading = np.zeros(agents)
        self._rate = np.zeros(agents)

    def complete(self, telemetry: Telemetry) -> Odometry:
        """Return the stream with a sample for each agent that has not streamed for a while.

        It is of the time at which the agent was last heard. Its yaw rate is that from one report
        to the next, which is what was turned in between.
        """
        streamed = telemetry.odometry
        now = telemetry.time
        self._streamed[streamed.agent] = now
        said = now - telemetry.age
        facing = telemetry.heading
        passed = said - self._time
        newer = np.isfinite(facing) & ~(passed <= LEAST)  # the first report is newer than none
        turned = wrap_angle(facing - self._heading)
        rate = np.where(np.isfinite(passed), turned, 0.0) / np.where(passed > LEAST, passed, 1.0)
        self._rate = np.where(newer, rate, self._rate)
        self._time = np.where(newer, said, self._time)
        self._heading = np.where(newer, facing, self._heading)
        silent = np.flatnonzero(now - self._streamed > SILENT)
        self.silent = set(silent.tolist())
        if not len(silent):
            return streamed
        still = np.zeros((len(silent), 3))
        level = Transform(facing[silent], still).turn_back(telemetry.velocity[silent])
        x, y, z, w = telemetry.attitude[silent].T
        roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
        return Odometry(
            agent=np.concatenate([streamed.agent, silent]),
            time=np.concatenate([streamed.time, said[silent]]),
            velocity=np.concatenate([streamed.velocity, level]),
            yaw_rate=np.concatenate([streamed.yaw_rate, self._rate[silent]]),
            roll=np.concatenate([streamed.roll, roll]),
            pitch=np.concatenate([streamed.pitch, pitch]),
            height=np.concatenate([streamed.height, telemetry.position[silent, 2]]),
        )
