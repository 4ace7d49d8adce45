"""Errors of positions to expect in a rehearsal, as the localizer announces them."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core import Array, Mission, Registry

PERIOD: Final = 1.0  # s, between two points of the paths
GROWTH: Final = 1.5  # of the time since the beginning, after which errors are computed anew
CLOCK_ERROR: Final = 1e-9  # s, rounding error of a sum of ticks


class Uncertainty:
    """The standard deviations of positions along the paths so far.

    They are computed when they are asked for, at times that grow geometrically: what the localizer
    announces is for whole paths. Between those times they are those of the last.
    """

    def __init__(self, mission: Mission, registry: Registry) -> None:
        localizer = mission.plugins["localizer"]
        self._scene, self._options = mission.scene, localizer.options
        self._drift = registry.find("localizer", localizer.use).offer.drift
        self._path: list[tuple[float, Array, Array]] = []
        self._due = 0.0  # s
        self._std = np.zeros(len(self._scene.agents))

    def add(self, time: float, position: Array, yaw: Array) -> None:
        """Add a point of the paths.

        Args:
            time: s.
            position: (N, 3) of the agents, m.
            yaw: (N,) rad.
        """
        if not self._path or time >= self._path[-1][0] + PERIOD - CLOCK_ERROR:
            self._path.append((time, position.copy(), yaw.copy()))

    def std(self) -> Array:
        """Return the standard deviations of the horizontal errors, (N,) m; 0 if not announced."""
        if self._drift is not None and self._path[-1][0] >= self._due:
            time, position, yaw = (np.array(values) for values in zip(*self._path, strict=True))
            self._std = self._drift(self._scene, time, position, yaw, **self._options)[-1]
            self._due = GROWTH * float(time[-1]) + PERIOD
        return self._std
