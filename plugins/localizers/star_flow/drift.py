"""Drift of on-board estimates, and an artificial error for studies."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Array, Scene

YAW_BIAS = math.radians(0.17)  # rad/s, gyro bias that remains after calibration, per flight
SCALE = 0.05  # relative error of a displacement by height and focal length, per flight
FLOOR = 2 * 0.045**2 * 0.7  # m²/m: 4.5 % error of scale with the floor, correlated over 0.7 m
TEXTURE = 3 * FLOOR  # three laps over one floor repeat its error, which triples the variance
NOISE = 3.0e-4  # m²/s, white noise of one count in each flow sample of 10 ms
START = 0.02  # m, std of an agent's manual placement
START_YAW = math.radians(1.0)  # rad, std of its heading
HEIGHT = 0.02  # m, std of z, which the range sensor measures without drift
MIN_STEP = 1e-9  # m, shorter steps count as this long


class Drift:
    """Covariance of dead-reckoned positions, which only grows while agents fly away.

    Constant errors add up along the path: a yaw bias rotates the motion ``dp`` at time ``t`` by
    ``bias * t``, so it shifts the position across ``m = sum(t * dp)``; a scale error stretches, and
    an initial heading error rotates, the displacement ``r``. Random walks are the floor's texture,
    along the path, and the sensor's noise, in all directions. The covariance in x and y is

    ``START² I + NOISE t I + TEXTURE sum(dp dp' / |dp|) + YAW_BIAS² Jm (Jm)' + SCALE² r r'
    + START_YAW² Jr (Jr)'``

    where ``J`` rotates by 90°; z is independent, with ``HEIGHT²``.

    Args:
        start: (N, 3) initial positions, map frame, m.
    """

    def __init__(self, start: Array) -> None:
        self._start: Array = start[:, :2].copy()
        self._last = self._start
        self._began: float | None = None
        self._texture = np.zeros((len(start), 2, 2))  # m²
        self._moment = np.zeros((len(start), 2))  # m s

    def covariance(self, time: float, position: Array) -> Array:
        """Return the (N, 3, 3) covariance, m², at `time`, s, after a move to `position` (N, 3), m.

        Drift grows from the time of the first call.
        """
        if self._began is None:
            self._began = time
        elapsed = time - self._began
        here = position[:, :2]
        step = here - self._last
        self._last = here
        self._moment += elapsed * step
        length = np.maximum(np.hypot(step[:, 0], step[:, 1]), MIN_STEP)
        self._texture += (TEXTURE / length)[:, None, None] * step[:, :, None] * step[:, None]
        away = here - self._start
        deviations = np.stack(
            [
                SCALE * away,
                START_YAW * away @ _QUARTER_TURN,
                YAW_BIAS * self._moment @ _QUARTER_TURN,
            ],
            axis=1,
        )  # (N, 3, 2) m, of one standard deviation of each constant error
        covariance = np.zeros((len(position), 3, 3))
        covariance[:, :2, :2] = self._texture + deviations.swapaxes(1, 2) @ deviations
        covariance[:, [0, 1, 2], [0, 1, 2]] += [*[START**2 + NOISE * elapsed] * 2, HEIGHT**2]
        return covariance


def heading_variance(elapsed: float) -> float:
    """Return the variance of a dead-reckoned heading `elapsed` s after its beginning, rad².

    >>> round(math.degrees(math.sqrt(heading_variance(60.0))), 1)
    10.2
    """
    return START_YAW**2 + (YAW_BIAS * elapsed) ** 2


_QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])  # of row vectors


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
