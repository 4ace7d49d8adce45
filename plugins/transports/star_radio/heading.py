"""Heading control: the yaw rate in a velocity setpoint that turns a drone to its heading."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core import Array, wrap_angle

GAIN: Final = 3.0  # 1/s; well below the bandwidth of the firmware's yaw-rate loop
MAX_YAW_RATE: Final = 2.0  # rad/s


def yaw_rate(wanted: Array, yaw: Array) -> Array:
    """Return the (N,) yaw rates that turn agents to their headings the shorter way, rad/s.

    The rate is ``GAIN`` times the heading error, at most `MAX_YAW_RATE`: the same law as in the
    simulator. It is 0 where the heading is unknown (NaN).

    Args:
        wanted: (N,) rad.
        yaw: (N,) as reported, rad.

    Example:
        >>> yaw_rate(np.array([0.1, 3.0, 1.0]), np.array([0.0, -3.0, np.nan])).round(3)
        array([ 0.3 , -0.85,  0.  ])
    """
    error = wrap_angle(wanted - yaw)
    rate = np.clip(GAIN * error, -MAX_YAW_RATE, MAX_YAW_RATE)
    return np.where(np.isnan(rate), 0.0, rate)
