"""How much wider agents are taken to be because their places are not known exactly."""

from __future__ import annotations

import numpy as np

from star_core import Array


def doubt(covariance: Array, deviations: float, most: Array) -> Array:
    """(N,) m that agents may be off along their worst direction in the plane.

    Args:
        covariance: (N, 3, 3) of their positions, m².
        deviations: How many standard deviations to count with.
        most: (N,) that much at most, and where nothing is known, m.
    """
    if deviations == 0.0:
        return np.zeros(len(covariance))
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    with np.errstate(invalid="ignore"):  # some are not finite
        variance = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)  # the greater eigenvalue
        off = deviations * np.sqrt(np.maximum(variance, 0.0))
    wider: Array = np.fmin(off, most)
    return wider
