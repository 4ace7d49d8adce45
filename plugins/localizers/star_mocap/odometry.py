"""Errors of odometry, and those of positions to expect from it and a positioning system."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Array, Scene

# Of a Flow deck, as `docs/results.md` has them.
SLIP: Final = 0.006  # m/s, at rest
SLIP_SHARE: Final = 0.07  # of the speed: errors of scale and of the floor
SLIP_TIME: Final = 3.0  # s, in which it changes: the floor's error does over 0.7 m
WALK: Final = 5e-4  # m²/s, noise of the flow sensor, as the on-board filter smooths it
YAW_WALK: Final = math.radians(0.3) ** 2  # rad²/s: the gyro's bias and noise

SOURCE_GAP: Final = 0.1  # s between two measurements of a source, and until they arrive
START_STD: Final = 0.05  # m, of an agent's manual placement
LAG_STD: Final = 0.025  # s, by which horizontal velocities lag: up to 23 ms in the simulator
REPORT_STD: Final = 0.0015  # m, by the unknown delay of a report: 3 ms at 0.5 m/s


def expected_std(
    scene: Scene,
    time: Array,
    position: Array,
    _yaw: Array,
    *,
    std: float = START_STD,
    source: object = None,
    **_options: object,
) -> Array:
    """Return the greatest standard deviation in the plane along paths: (T, N) m.

    It is that of the measurements, with what odometry adds in the longest time without one: a walk,
    and a Gauss-Markov velocity error whose variance grows as in `star_mocap.kernel`. Without
    measurements it is that of the start.

    Args:
        scene: Agents, and errors of the measurements.
        time: (T,) s.
        position: (T, N, 3) m.
        std: Standard deviation of a source's positions along each axis, m.
        source: The source; None if the transport measures.
    """
    if source is not None:
        gap = SOURCE_GAP
    elif scene.measurement_errors is not None:
        std, gap = scene.measurement_errors
    else:
        return np.full(position.shape[:2], START_STD)
    velocity = np.gradient(position, time, axis=0) if len(time) > 1 else np.zeros_like(position)
    slip = SLIP + SLIP_SHARE * np.hypot(velocity[..., 0], velocity[..., 1])
    ratio = gap / SLIP_TIME
    slipped = 2 * (slip * SLIP_TIME) ** 2 * (ratio + math.expm1(-ratio))
    expected: Array = np.sqrt(std**2 + REPORT_STD**2 + WALK * gap + slipped)
    return expected
