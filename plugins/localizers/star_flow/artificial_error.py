"""Artificial position errors, for studies of how much error other plugins tolerate."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Array, Scene

SEED: Final = 0x0E44  # separates these random streams from those of other plugins
BLOCK: Final = 64  # draws that each generator makes at once: one call costs as much as for one


class ArtificialError:
    """An Ornstein-Uhlenbeck process for each axis of each agent, independent of the others.

    It has the same standard deviation at all times and an exponential autocorrelation: after ``dt``
    it is ``c e + std sqrt(1 - c²) n`` with ``c = exp(-dt / time_constant)`` and a fresh normal
    ``n``, the exact step of Uhlenbeck and Ornstein (Phys. Rev. 36, 1930).

    Args:
        scene: Agents and seed: the same agent has the same error with every avoider.
        std: Standard deviation along each axis, m.
        time_constant: Correlation time, s.
    """

    def __init__(self, scene: Scene, *, std: float, time_constant: float) -> None:
        self._std = std
        self._time_constant = time_constant
        self._streams = [
            np.random.default_rng([scene.seed, SEED, row]) for row in range(len(scene.agents))
        ]
        self._normals = np.zeros((len(self._streams), BLOCK, 3))
        self._used = BLOCK
        self._time = -math.inf
        self._error = np.zeros((len(self._streams), 3))

    def at(self, time: float) -> Array:
        """Return the (N, 3) error at `time`, s, which does not decrease between calls, m."""
        kept = math.exp(min(0.0, self._time - time) / self._time_constant)
        fresh = self._std * math.sqrt(1 - kept * kept)
        if fresh > 0:
            self._error = kept * self._error + fresh * self._draw()
            self._time = time
        return self._error

    def _draw(self) -> Array:
        """Return fresh normal deviates (N, 3)."""
        if self._used == BLOCK:
            for row, stream in enumerate(self._streams):
                self._normals[row] = stream.standard_normal((BLOCK, 3))
            self._used = 0
        self._used += 1
        drawn: Array = self._normals[:, self._used - 1]
        return drawn
