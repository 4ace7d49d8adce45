"""How far off an estimate from optical flow alone can be.

The sources of drift and their sizes are those that make a simulated Crazyflie with the firmware's
own estimator and a flow deck drift as the original STAR paper reports for flights without tags.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from star_core import Array, compiled

YAW_BIAS = math.radians(0.17)  # rad/s: what the gyroscope's calibration leaves, for a whole flight
SCALE = 0.05  # of the displacement: height and focal length, for a whole flight
FLOOR = 2 * 0.045**2 * 0.7  # m²/m: 4.5 % error of scale with the floor, correlated over 0.7 m
TEXTURE = 3 * FLOOR  # three laps over one floor repeat its error, which triples the variance
NOISE = 3.0e-4  # m²/s: white noise of one count in each flow sample of 10 ms
START = 0.02  # m: placing an agent by hand
START_YAW = math.radians(1.0)  # rad: turning it by hand
HEIGHT = 0.02  # m: z comes from the range sensor and does not drift
STILL = 1e-9  # m: less is no motion


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
        self._start: Array = start[:, :2].copy()
        self._last = self._start.copy()
        self._began: float | None = None
        self._texture = np.zeros((len(start), 2, 2))  # its upper triangle
        self._moment = np.zeros((len(start), 2))

    def covariance(self, time: float, position: Array) -> Array:
        """Return the (N, 3, 3) covariance, m², at `time`, s, after a move to `position` (N, 3), m.

        Drift grows from the time of the first call.
        """
        if self._began is None:
            self._began = time
        covariance = np.zeros((len(position), 3, 3))
        grow(
            covariance,
            np.ascontiguousarray(position),
            self._start,
            self._last,
            self._texture,
            self._moment,
            time - self._began,
        )
        return covariance


@partial(compiled, alone=True)
def grow(
    covariance: Array,
    position: Array,
    start: Array,
    last: Array,
    texture: Array,
    moment: Array,
    elapsed: float,
) -> None:
    """Let drift grow by a move, and say what it is then.

    Args:
        covariance: (N, 3, 3) what it is, m²; zeros that are written over.
        position: (N, 3) where the agents have come, m.
        start: (N, 2) where they began, m.
        last: (N, 2) where they were, m; becomes where they are.
        texture: (N, 2, 2) what the floor's texture has added up to, m²; grows.
        moment: (N, 2) sum of t * dp, m s; grows.
        elapsed: Since they began, s.
    """
    for row in range(len(position)):
        step_x, step_y = position[row, 0] - last[row, 0], position[row, 1] - last[row, 1]
        last[row, 0], last[row, 1] = position[row, 0], position[row, 1]
        moment[row, 0] += elapsed * step_x
        moment[row, 1] += elapsed * step_y
        per_metre = TEXTURE / max(math.hypot(step_x, step_y), STILL)
        texture[row, 0, 0] += per_metre * step_x * step_x
        texture[row, 0, 1] += per_metre * step_x * step_y
        texture[row, 1, 1] += per_metre * step_y * step_y
        away_x, away_y = position[row, 0] - start[row, 0], position[row, 1] - start[row, 1]
        stretched_x, stretched_y = SCALE * away_x, SCALE * away_y
        turned_x, turned_y = -START_YAW * away_y, START_YAW * away_x
        bent_x, bent_y = -YAW_BIAS * moment[row, 1], YAW_BIAS * moment[row, 0]
        every_way = START**2 + NOISE * elapsed
        here = covariance[row]
        here[0, 0] = every_way + texture[row, 0, 0] + stretched_x**2 + turned_x**2 + bent_x**2
        here[1, 1] = every_way + texture[row, 1, 1] + stretched_y**2 + turned_y**2 + bent_y**2
        here[0, 1] = here[1, 0] = (
            texture[row, 0, 1] + stretched_x * stretched_y + turned_x * turned_y + bent_x * bent_y
        )
        here[2, 2] = HEIGHT**2


def heading_variance(elapsed: float) -> float:
    """Return the variance of a dead-reckoned heading `elapsed` s after its beginning, rad².

    >>> round(math.degrees(math.sqrt(heading_variance(60.0))), 1)
    10.2
    """
    return START_YAW**2 + (YAW_BIAS * elapsed) ** 2
