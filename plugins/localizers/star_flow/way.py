"""The way that agents have come in the last seconds: an image is of the past when it arrives."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Telemetry

MEMORY: Final = 6.0  # s, for which it is kept
AHEAD: Final = 0.1  # s, by which a time may be newer than the newest report


class Place(NamedTuple):
    """Where agents were.

    Attributes:
        tick: Mission time, s.
        time: (N,) of each agent's report, s.
        position: (N, 3) in the map, m.
        attitude: (N, 4) unit quaternion x, y, z, w from the body to the odometry frame.
        covariance: (N, 3, 3) of the position, m².
    """

    tick: float
    time: Array
    position: Array
    attitude: Array
    covariance: Array


class Way:
    """Keeps where agents were."""

    def __init__(self) -> None:
        self._places: deque[Place] = deque()

    def go_on(self, telemetry: Telemetry, position: Array, covariance: Array) -> None:
        """Take in where the agents are now: (N, 3) m in the map, and (N, 3, 3) m²."""
        now, heard = telemetry.time, telemetry.time - telemetry.age
        self._places.append(Place(now, heard, position, telemetry.attitude, covariance))
        while self._places[0].tick < now - MEMORY:
            self._places.popleft()

    def at(self, row: int, time: float) -> tuple[Array, Array, Array] | None:
        """Return where one agent was at `time`, s, or None where that is not known.

        Between two reports its position (3,) and its attitude (4,) change evenly; the covariance
        (3, 3) is that of the later one.
        """
        heard = [place for place in self._places if math.isfinite(place.time[row])]
        times = [place.time[row] for place in heard]
        if not times or not times[0] <= time <= times[-1] + AHEAD:
            return None
        after = min(bisect_right(times, time), len(times) - 1)
        one, other = heard[max(after - 1, 0)], heard[after]
        lasts = other.time[row] - one.time[row]
        share = min(1.0, (time - one.time[row]) / lasts) if lasts > 0 else 1.0
        first, last = one.attitude[row], other.attitude[row]
        attitude = (1 - share) * first + share * last * (1.0 if first @ last >= 0 else -1.0)
        position = (1 - share) * one.position[row] + share * other.position[row]
        if not np.isfinite(attitude).all():
            return None
        return position, attitude / np.linalg.norm(attitude), other.covariance[row]
