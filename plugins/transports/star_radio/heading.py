"""Turns the heading a drone should have into the yaw rate that its velocity setpoint carries."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Array

GAIN: Final = 3.0  # 1/s; well below the firmware's own yaw loop, which holds a rate
FASTEST: Final = 2.0  # rad/s


def yaw_rate(wanted: Array, yaw: Array) -> Array:
    """Return the (N,) rate that turns each agent to its heading the shorter way round, rad/s.

    It is ``GAIN`` times the angle that is missing, at most `FASTEST`: the law by which the
    simulator holds the same setpoint. Where the heading is not known (NaN) it is 0.

    Args:
        wanted: (N,) rad.
        yaw: (N,) as reported, rad.

    Example:
        >>> yaw_rate(np.array([0.1, 3.0, 1.0]), np.array([0.0, -3.0, np.nan])).round(3)
        array([ 0.3 , -0.85,  0.  ])
    """
    missing = np.remainder(wanted - yaw + math.pi, math.tau) - math.pi
    rate = np.clip(GAIN * missing, -FASTEST, FASTEST)
    return np.where(np.isnan(rate), 0.0, rate)
