"""Margins by which agents whose positions are uncertain keep farther apart."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core.messages.arrays import Array

MAX_MARGIN_RATIO: Final = 2.0
"""Greatest margin for an uncertain position, over the radius of an agent without it: in crossings
of five drones with errors of 0.3 m, 1 was not enough for a safe distance, 2 was."""


def position_margin(covariance: Array, deviations: float, radius: float) -> Array:
    """Return by how much the radius of each agent grows for its uncertain position, (N,) m.

    It is a number of standard deviations in the horizontal direction of the greatest uncertainty,
    at most `MAX_MARGIN_RATIO` radii, also where the covariance is not finite.

    Args:
        covariance: (N, 3, 3) of the positions, m².
        deviations: Number of standard deviations.
        radius: Half the distance that is kept between two agents with exact positions, m.

    Example:
        >>> position_margin(np.diag([0.01, 0.04, 1.0])[None], 2.0, 1.0)
        array([0.4])
    """
    if deviations == 0.0:
        return np.zeros(len(covariance))
    std = deviations * position_deviation(covariance)
    margin: Array = np.fmin(std, MAX_MARGIN_RATIO * radius)
    return margin


_last: tuple[Array, Array] | None = None  # a covariance that is read-only, and its deviations


def position_deviation(covariance: Array) -> Array:
    """Return the standard deviation in the horizontal direction of the greatest one, (N,) m.

    It is infinite where the covariance is not finite.

    Several stages of a tick need it of the same table.
    """
    global _last  # noqa: PLW0603 -- a result that is used again
    if _last is not None and _last[0] is covariance:
        return _last[1]
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    with np.errstate(invalid="ignore"):  # some are not finite
        variance = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)  # the greater eigenvalue
        deviation: Array = np.fmin(np.sqrt(np.maximum(variance, 0.0)), np.inf)
    if not covariance.flags.writeable and covariance.base is None:
        _last = covariance, deviation
    return deviation


WALL_RADIUS: Final = 0.2
"""Distance to fence and obstacles that the core takes for the radius of an agent where it limits
margins to `MAX_MARGIN_RATIO` of it, m: the clearance that planners keep by default."""


ALONE_SHARE: Final = 0.75
"""Share of the room between two agents that they need without others near them: by default one and
a half standard deviations. Among several, each neighbor adds to the risk."""


YIELD_TIME: Final = 5.0
"""Time constant with which margins for uncertain positions yield to agents that press on, s."""


def yielding_margin(margin: Array, room: Array, horizon: float) -> Array:
    """Return the margins for uncertain positions that agents keep at some distances, m.

    Within a margin the permitted approach decays with `YIELD_TIME`. So two agents slow down, but
    those whose goals are that near to each other still reach them, and none is pushed away because
    its position becomes uncertain.

    Args:
        margin: Margins, m.
        room: Distances beyond those that agents keep without a margin, m; may be negative.
        horizon: Time in which the avoider lets agents use up a distance, s.

    Example:
        >>> yielding_margin(np.full(3, 0.25), np.array([1.0, 0.2, -0.1]), 0.5)
        array([0.25, 0.18, 0.  ])
    """
    kept: Array = np.minimum(margin, max(0.0, 1 - horizon / YIELD_TIME) * np.maximum(room, 0.0))
    return kept
