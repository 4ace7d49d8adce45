"""The error with which drones are expected to follow a trajectory, by a model of their control."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from star_core import Setpoint
from star_core.toolkit import TRACKING_GAIN, VELOCITY_GAIN, VelocityLead

if TYPE_CHECKING:
    from star_core import Array
    from star_verbs.follow.trajectory import PolynomialPath

STEP: Final = 0.01  # s
TILT_LAG: Final = 0.1  # s, with which the drone has the acceleration that is commanded
MAX_ACCELERATION: Final = 9.81 * math.tan(math.radians(20.0))  # m/s², PID_VEL_ROLL_MAX
POSITION_GAIN: Final = 2.0  # 1/s, PID_POS_X_KP
MODELLED: Final = 120.0  # s of a flight: a longer one takes too long in `star check`
MAX_SPEED: Final = 1.1  # m/s along each axis, of its position control


class TrackingError(NamedTuple):
    """Distance of a drone from its point on a trajectory at equal times, m."""

    rms: float
    most: float


def tracking_error(
    path: PolynomialPath, timescale: float, period: float, *, on_board: bool
) -> TrackingError:
    """Return the error to expect, horizontally, besides that of the drone's own estimate.

    The model is that of the firmware's PID controller: an acceleration in proportion to the error
    of the velocity, up to the greatest tilt, and a drone that has it `TILT_LAG` later. Velocities
    come from `VelocityLead` each tick, or on board from the error of the position.
    Of a longer trajectory the first `MODELLED` seconds are modelled.

    Args:
        path: The trajectory in its own time.
        timescale: Factor by which its duration is stretched.
        period: Of the ticks, s.
        on_board: Whether the drone's commander flies it.
    """
    time = np.arange(0.0, min(path.length * timescale, MODELLED), STEP) / timescale
    point, velocity = path.at(time)
    velocity /= timescale
    acceleration = path.acceleration(time)[0] / timescale**2
    lead, every = VelocityLead(1, period), max(1, round(period / STEP))
    position, speed, tilt = point[0].copy(), np.zeros(3), np.zeros(3)
    commanded, errors = np.zeros(3), np.empty(len(time))
    for i in range(len(time)):
        away = point[i] - position
        errors[i] = math.hypot(away[0], away[1])
        if on_board:
            commanded = np.clip(POSITION_GAIN * away, -MAX_SPEED, MAX_SPEED)
        elif i % every == 0:
            commanded = _sent(lead, point[i], velocity[i] + TRACKING_GAIN * away, acceleration[i])
        more = VELOCITY_GAIN * (commanded - speed)
        more *= min(1.0, MAX_ACCELERATION / max(1e-9, math.hypot(more[0], more[1])))
        tilt += STEP / TILT_LAG * (more - tilt)
        position += STEP * (speed + STEP / 2 * tilt)
        speed += STEP * tilt
    return TrackingError(float(np.sqrt(np.mean(errors**2))), float(errors.max()))


def _sent(lead: VelocityLead, point: Array, velocity: Array, acceleration: Array) -> Array:
    """Return the velocity that a transport sends, (3,) m/s."""
    setpoint = Setpoint(
        velocity[None], np.zeros(1), np.ones(1, np.bool_), point[None], acceleration[None]
    )
    sent: Array = lead.velocity(setpoint)[0]
    return sent
