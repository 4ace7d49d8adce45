"""An error that is added to positions on purpose, so that studies can ask how much others bear."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Array, Scene

SEED: Final = 0x0E44  # sets these draws apart from those of other plugins
BLOCK: Final = 64
"""Draws that each agent's generator makes at once: one call costs as much as for one."""


class Error:
    """An Ornstein-Uhlenbeck process for each axis of each agent, independent of the others.

    It is a normal deviate of the same size at all times, and is forgotten with a time constant:
    after ``dt`` it is ``c e + size sqrt(1 - c²) n`` with ``c = exp(-dt / time_constant)`` and a
    fresh normal ``n``, the exact step of Uhlenbeck and Ornstein (Phys. Rev. 36, 1930).

    Args:
        scene: Agents and seed: the same agent has the same error with every avoider.
        size: Standard deviation along each axis, m.
        time_constant: After which it has fallen to 1/e of itself, s.
    """

    def __init__(self, scene: Scene, *, size: float, time_constant: float) -> None:
        self._size = size
        self._time_constant = time_constant
        self._streams = [
            np.random.default_rng([scene.seed, SEED, row]) for row in range(len(scene.agents))
        ]
        self._normals = np.zeros((len(self._streams), BLOCK, 3))
        self._used = BLOCK
        self._time = -math.inf
        self._now = np.zeros((len(self._streams), 3))

    def at(self, time: float) -> Array:
        """Return the (N, 3) error at `time`, s, which is that of the last call or later, m."""
        kept = math.exp(min(0.0, self._time - time) / self._time_constant)
        fresh = self._size * math.sqrt(1 - kept * kept)
        if fresh > 0:
            self._now = kept * self._now + fresh * self._draw()
            self._time = time
        return self._now

    def _draw(self) -> Array:
        """Return fresh normal deviates (N, 3)."""
        if self._used == BLOCK:
            for row, stream in enumerate(self._streams):
                self._normals[row] = stream.standard_normal((BLOCK, 3))
            self._used = 0
        self._used += 1
        drawn: Array = self._normals[:, self._used - 1]
        return drawn
