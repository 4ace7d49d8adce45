"""Recent poses of the agents: an image shows the past when it arrives."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Telemetry

DURATION: Final = 6.0  # s, for which poses are kept
EXTRAPOLATION: Final = 0.1  # s, by which a time may be newer than the newest report


class Poses(NamedTuple):
    """Poses of all agents at one tick."""

    tick: float  # mission time, s
    time: Array  # (N,) of each agent's report, s
    position: Array  # (N, 3) in the map, m
    attitude: Array  # (N, 4) unit quaternion x, y, z, w from the body to the odometry frame
    covariance: Array  # (N, 3, 3) of the position, m²


class PoseHistory:
    """Keeps the poses of the last `DURATION` seconds."""

    def __init__(self) -> None:
        self._history: deque[Poses] = deque()

    def add(self, telemetry: Telemetry, position: Array, covariance: Array) -> None:
        """Add the agents' current positions: (N, 3) m in the map, and (N, 3, 3) m²."""
        now, reported = telemetry.time, telemetry.time - telemetry.age
        self._history.append(Poses(now, reported, position, telemetry.attitude, covariance))
        while self._history[0].tick < now - DURATION:
            self._history.popleft()

    def at(self, row: int, time: float) -> tuple[Array, Array, Array] | None:
        """Return one agent's pose at `time`, s, or None if it is not known.

        Position (3,) and attitude (4,) are interpolated between reports; the covariance (3, 3) is
        that of the later one.
        """
        poses = [pose for pose in self._history if np.isfinite(pose.time[row])]
        times = [pose.time[row] for pose in poses]
        if not times or not times[0] <= time <= times[-1] + EXTRAPOLATION:
            return None
        after = min(bisect_right(times, time), len(times) - 1)
        one, other = poses[max(after - 1, 0)], poses[after]
        interval = other.time[row] - one.time[row]
        share = min(1.0, (time - one.time[row]) / interval) if interval > 0 else 1.0
        first, last = one.attitude[row], other.attitude[row]
        attitude = (1 - share) * first + share * last * (1.0 if first @ last >= 0 else -1.0)
        position = (1 - share) * one.position[row] + share * other.position[row]
        if not np.isfinite(attitude).all():
            return None
        return position, attitude / np.linalg.norm(attitude), other.covariance[row]
