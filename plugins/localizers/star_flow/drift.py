"""How far off an estimate from optical flow alone can be.

The sources of drift and their sizes are those that make a simulated Crazyflie with the firmware's
own estimator and a flow deck drift as the original STAR paper reports for flights without tags.
"""

from __future__ import annotations

import math

import numpy as np

from star_core import Array

YAW_BIAS = math.radians(0.17)  # rad/s: what the gyroscope's calibration leaves, for a whole flight
SCALE = 0.05  # of the displacement: height and focal length, for a whole flight
FLOOR = 2 * 0.045**2 * 0.7  # m²/m: 4.5 % error of scale with the floor, correlated over 0.7 m
TEXTURE = 3 * FLOOR  # three laps over one floor repeat its error, which triples the variance
NOISE = 3.0e-4  # m²/s: white noise of one count in each flow sample of 10 ms
START = 0.02  # m: placing an agent by hand
START_YAW = math.radians(1.0)  # rad: turning it by hand
HEIGHT = 0.02  # m: z comes from the range sensor and does not drift
STILL = 1e-9  # m: less is no motion
QUARTER = np.array([[-1.0], [1.0]])  # by which y and x, exchanged, are x and y turned by a quarter


class Drift:
    """The covariance of dead-reckoned positions, which only grows while agents fly away.

    What stays the same for a flight adds up along it: a yaw bias turns the motion ``dp`` at time
    ``t`` by ``bias * t``, so it shifts the position across ``m = sum(t * dp)``; a wrong scale
    stretches, and a wrong start turns, the displacement ``r``. What changes walks: the floor's
    texture along the way, and the sensor's noise every way. The covariance in x and y is

    ``START² I + NOISE t I + TEXTURE sum(dp dp' / |dp|) + YAW_BIAS² Jm (Jm)' + SCALE² r r'
    + START_YAW² Jr (Jr)'``

    where ``J`` turns by a quarter; z is apart with ``HEIGHT²``. Nothing ever sets it back.

    Args:
        start: (N, 3) where the agents start, map frame, m.
    """

    def __init__(self, start: Array) -> None:
        n = len(start)
        self._start: Array = start[:, :2].T.copy()  # (2, N): x and y are worked on apart
        self._last: Array = self._start
        self._began: float | None = None
        self._texture = np.zeros((2, 2, n))
        self._moment = np.zeros((2, n))  # sum of t * dp, m s
        self._fixed = np.tile(np.diag([START**2, START**2, HEIGHT**2]), (n, 1, 1))

    def covariance(self, time: float, position: Array) -> Array:
        """Return the (N, 3, 3) covariance, m², at `time`, s, after a move to `position` (N, 3), m.

        Drift grows from the time of the first call.
        """
        if self._began is None:
            self._began = time
        elapsed = time - self._began
        here: Array = position[:, :2].T.copy()
        step = here - self._last
        self._last = here
        self._moment += elapsed * step
        walks = step * np.sqrt(TEXTURE / np.maximum(np.hypot(*step), STILL))
        self._texture += walks[:, None] * walks
        away = here - self._start
        stays = np.empty((3, *away.shape))  # what adds up along the flight
        np.multiply(away, SCALE, out=stays[0])
        np.multiply(away[::-1], START_YAW * QUARTER, out=stays[1])
        np.multiply(self._moment[::-1], YAW_BIAS * QUARTER, out=stays[2])
        flat = np.einsum("kin,kjn->ijn", stays, stays) + self._texture
        covariance = self._fixed.copy()
        covariance[:, :2, :2] += flat.transpose(2, 0, 1)
        covariance[:, (0, 1), (0, 1)] += NOISE * elapsed
        return covariance


def heading_variance(elapsed: float) -> float:
    """Return the variance of a dead-reckoned heading `elapsed` s after its beginning, rad².

    >>> round(math.degrees(math.sqrt(heading_variance(60.0))), 1)
    10.2
    """
    return START_YAW**2 + (YAW_BIAS * elapsed) ** 2
