"""The margin that uncertain position estimates add to the radii of agents."""

from __future__ import annotations

import numpy as np

from star_core import Array


def position_uncertainty(covariance: Array, margin: float, limit: Array) -> Array:
    """(N,) margin in the horizontal direction of the greatest uncertainty, m.

    Args:
        covariance: (N, 3, 3) of the positions, m².
        margin: Number of standard deviations.
        limit: (N,) greatest result, also where the covariance is not finite, m.
    """
    if margin == 0.0:
        return np.zeros(len(covariance))
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    with np.errstate(invalid="ignore"):  # some are not finite
        variance = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)  # the greater eigenvalue
        std = margin * np.sqrt(np.maximum(variance, 0.0))
    extra: Array = np.fmin(std, limit)
    return extra
