"""Odometry of agents that stream none, from their state reports."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core import Odometry, Telemetry, Transform, wrap_angle

MAX_SILENCE: Final = 0.5  # s without a sample, after which reports replace the stream
MIN_INTERVAL: Final = 1e-6  # s between two reports; less is one report, repeated


class ReportOdometry:
    """Completes the odometry stream; `silent` has the agents whose samples are from reports."""

    def __init__(self, agents: int) -> None:
        self.silent: set[int] = set()
        self._streamed = np.full(agents, -np.inf)  # s, time of the last sample
        self._time = np.full(agents, np.nan)  # s, of the last report with a heading
        self._heading = np.zeros(agents)
        self._rate = np.zeros(agents)

    def complete(self, telemetry: Telemetry) -> Odometry:
        """Return the stream with a sample for each agent that has not streamed for a while.

        The sample has the time of the agent's report. Its yaw rate is the mean since the previous
        report.
        """
        streamed = telemetry.odometry
        now = telemetry.time
        self._streamed[streamed.agent] = now
        reported = now - telemetry.age
        heading = telemetry.heading
        passed = reported - self._time
        newer = np.isfinite(heading) & ~(passed <= MIN_INTERVAL)  # the first report is newer too
        turned = wrap_angle(heading - self._heading)
        rate = np.where(np.isfinite(passed), turned, 0.0)
        rate /= np.where(passed > MIN_INTERVAL, passed, 1.0)
        self._rate = np.where(newer, rate, self._rate)
        self._time = np.where(newer, reported, self._time)
        self._heading = np.where(newer, heading, self._heading)
        silent = np.flatnonzero(now - self._streamed > MAX_SILENCE)
        self.silent = set(silent.tolist())
        if not len(silent):
            return streamed
        level = Transform(heading[silent], np.zeros((len(silent), 3)))
        x, y, z, w = telemetry.attitude[silent].T
        samples = {
            "agent": silent,
            "time": reported[silent],
            "velocity": level.turn_back(telemetry.velocity[silent]),
            "yaw_rate": self._rate[silent],
            "roll": np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            "pitch": np.arcsin(np.clip(2 * (w * y - z * x), -1, 1)),
            "height": telemetry.position[silent, 2],
        }
        return Odometry(
            **{
                name: np.concatenate([getattr(streamed, name), sample])
                for name, sample in samples.items()
            }
        )
