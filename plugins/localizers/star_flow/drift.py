"""Drift of on-board estimates, and an artificial error for studies."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from star_core import Array, Scene
from star_core.toolkit import position_margin

YAW_BIAS = math.radians(0.2)  # rad/s, gyro bias that remains after calibration, per flight
SCALE = 0.05  # relative error of a displacement by height and focal length, per flight
FLOOR = 2 * 0.045**2 * 0.7  # m²/m: 4.5 % error of scale with the floor, correlated over 0.7 m
TEXTURE = 3 * FLOOR  # three laps over one floor repeat its error, which triples the variance
NOISE = 1.7e-3  # m²/s at 1 m, white noise of two counts in each flow sample of 10 ms
LEAST_HEIGHT = 0.1  # m, for that: its variance grows with the square of the height
START = 0.05  # m, std of an agent's manual placement, and while the estimated tilt settles
START_YAW = math.radians(1.0)  # rad, std of its heading
HEIGHT = 0.02  # m, std of z, which the range sensor measures without drift
MIN_STEP = 1e-9  # m, shorter steps count as this long

# Velocity errors along each axis of the body: constant, and by a gyro whose bias wanders.
VELOCITY_STD = np.array([0.004, 0.0058])  # m/s
VELOCITY_VARIANCE = VELOCITY_STD**2
VELOCITY_RATE = np.array([0.0, 1 / 30.0])  # 1/s, one over the correlation time


def follow_move(
    row: Any,
    deviations: Array,
    position: Array,
    last: Array,
    begin: tuple[Array, Array],
    state: tuple[Any, Array, Array, Array],
    period: float,
    elapsed: float,
) -> None:
    """Add a move to the state of `Drift`, which is changed.

    It is plain arithmetic: flights compile it for one row after the other.

    Args:
        row: Of the agent; or ``slice(None)``, for all of them.
        deviations: (N, 3, 2) output: one standard deviation of each constant error, m.
        position: (N, 3) m.
        last: (N, 2) positions before the move, m; changed to those after it.
        begin: (N, 2) starts, and (N,) their heights, m.
        state: (N, 2) coupling, m²/s, complex; (N,) variance walked, m²; (N, 2) moment, m s; and
            (N, 2, 2) variance by texture, m².
        period: Time since the last move, s.
        elapsed: Time since the first, s.
    """
    (start, ground), (coupling, walked, moment, texture) = begin, state
    x, y = position[row, 0] - last[row, 0], position[row, 1] - last[row, 1]
    last[row, 0], last[row, 1] = position[row, 0], position[row, 1]
    moment[row, 0] += elapsed * x
    moment[row, 1] += elapsed * y
    rough = TEXTURE / np.maximum(np.hypot(x, y), MIN_STEP)
    texture[row, 0, 0] += rough * x * x
    texture[row, 0, 1] += rough * x * y
    texture[row, 1, 0] += rough * y * x
    texture[row, 1, 1] += rough * y * y
    walked[row] += 2 * period * (coupling[row, 0].real + coupling[row, 1].real)
    height = np.maximum(position[row, 2] - ground[row], LEAST_HEIGHT)
    walked[row] += period * NOISE * (height * height)
    x, y = position[row, 0] - start[row, 0], position[row, 1] - start[row, 1]
    deviations[row, 0, 0], deviations[row, 0, 1] = SCALE * x, SCALE * y
    deviations[row, 1, 0] = -(START_YAW * y)  # turned by 90°, as the next
    deviations[row, 1, 1] = START_YAW * x
    deviations[row, 2, 0] = -(YAW_BIAS * moment[row, 1])
    deviations[row, 2, 1] = YAW_BIAS * moment[row, 0]


_FOLLOW_ALL = partial(follow_move, slice(None))


class Drift:
    """Covariance of dead-reckoned positions, which only grows while agents fly away.

    Constant errors add up along the path: a yaw bias rotates the motion ``dp`` at time ``t`` by
    ``bias * t``, so it shifts the position across ``m = sum(t * dp)``; a scale error stretches, and
    an initial heading error rotates, the displacement ``r``. Random walks are the floor's texture,
    along the path, and the sensor's noise, in all directions. The covariance in x and y is

    ``START² I + (NOISE sum(h² dt) + w) I + TEXTURE sum(dp dp' / |dp|) + YAW_BIAS² Jm (Jm)'
    + SCALE² r r' + START_YAW² Jr (Jr)'``

    where ``J`` rotates by 90°, ``h`` is the height above the start, and ``w`` is the variance by
    errors of the velocity. These are first-order Gauss-Markov processes along the axes of the body,
    which turn with it: with standard deviation ``s``, rate ``a`` and heading ``psi``, the
    covariance ``c`` of position and velocity follows ``dc/dt = s² - (a + i dpsi/dt) c`` in the
    complex plane, and ``dw/dt = 2 Re c``. So they cancel over a turn, but not in a hover. z is
    independent, with ``HEIGHT²``.

    Args:
        start: (N, 3) initial positions, map frame, m.
        yaw: (N,) initial headings, rad.
        follow: Adds a move to the state of all agents, as `follow_move` does.
    """

    def __init__(self, start: Array, yaw: Array, follow: Callable[..., None] = _FOLLOW_ALL) -> None:
        self._follow = follow
        self._start: Array = start[:, :2].copy()
        self._last = self._start.copy()
        self._ground = start[:, 2].copy()
        self._time: float | None = None
        self._began = 0.0
        self._yaw = yaw
        self._texture = np.zeros((len(start), 2, 2))  # m²
        self._moment = np.zeros((len(start), 2))  # m s
        self._coupling = np.zeros((len(start), 2), np.complex128)  # m²/s, of each velocity error
        self._walked = np.zeros(len(start))  # m², by errors of the velocity and by noise

    def covariance(self, time: float, position: Array, yaw: Array) -> Array:
        """Return the (N, 3, 3) covariance, m², at a time after a move.

        Drift grows from the time of the first call.

        Args:
            time: Mission time, s.
            position: (N, 3) m.
            yaw: (N,) headings, rad.
        """
        if self._time is None:
            self._time = self._began = time
        period, elapsed = time - self._time, time - self._began
        self._time = time
        turn = -1j * (yaw - self._yaw)[:, None]  # of any turns: 2 pi is none
        self._coupling *= np.exp(turn - period * VELOCITY_RATE)
        self._coupling += period * VELOCITY_VARIANCE
        self._yaw = yaw
        deviations = np.empty((len(position), 3, 2))
        state = self._coupling, self._walked, self._moment, self._texture
        begin = self._start, self._ground
        self._follow(deviations, position, self._last, begin, state, period, elapsed)
        covariance = np.zeros((len(position), 3, 3))
        covariance[:, :2, :2] = self._texture + deviations.swapaxes(1, 2) @ deviations
        level = START**2 + self._walked
        covariance[:, 0, 0] += level
        covariance[:, 1, 1] += level
        covariance[:, 2, 2] = HEIGHT**2
        return covariance


EXACT_STD = 0.001  # m, of positions by odometry without errors: covariances stay regular


class NoDrift:
    """Covariance of positions by odometry without errors (`Scene.exact_odometry`)."""

    def __init__(self, agents: int) -> None:
        self._covariance: Array = np.tile(EXACT_STD**2 * np.eye(3), (agents, 1, 1))

    def covariance(self, _time: float, _position: Array, _yaw: Array) -> Array:
        """Return the (N, 3, 3) covariance, m²."""
        return self._covariance.copy()


def drift_of(
    scene: Scene, start: Array, yaw: Array, follow: Callable[..., None] = _FOLLOW_ALL
) -> Drift | NoDrift:
    """Return the drift of a scene's agents from (N, 3) starts, m, with (N,) headings, rad."""
    return NoDrift(len(start)) if scene.exact_odometry else Drift(start, yaw, follow)


def expected_std(
    scene: Scene, time: Array, position: Array, yaw: Array, *, error_std: float, **_options: object
) -> Array:
    """Return the greatest standard deviation in the plane along paths: (T, N) m.

    Args:
        scene: Agents.
        time: (T,) s.
        position: (T, N, 3) m.
        yaw: (T, N) rad.
        error_std: The artificial error, m.
    """
    drift = drift_of(scene, np.array([agent.start for agent in scene.agents]), yaw[0])
    rows = zip(time.tolist(), position, yaw, strict=True)
    covariance = [drift.covariance(*row) + error_std**2 * np.eye(3) for row in rows]
    return np.array([position_margin(matrix, 1.0, math.inf) for matrix in covariance])


def heading_variance(elapsed: float) -> float:
    """Return the variance of a dead-reckoned heading `elapsed` s after its beginning, rad².

    >>> round(math.degrees(math.sqrt(heading_variance(60.0))), 1)
    12.0
    """
    return START_YAW**2 + (YAW_BIAS * elapsed) ** 2


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
