"""How a square tag lies before the camera, from its four corners: two answers."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import cv2
import numpy as np

from star_apriltag.vision.lens import Lens
from star_apriltag.vision.rigid import Pose
from star_core import Array

HALVES: Final = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
"""Corners of a tag of size 1 in its own frame: bottom left, bottom right, top right, top left."""

AFTER: Final = [1, 2, 3, 0]

# The deviation of a corner, px: LEAST, and AT_METRES for a tag of 0.168 m at METRES, which grows
# with that POWER of the distance. Fitted to flights in simulation over a surveyed map.
LEAST: Final = 0.30
AT_METRES: Final = 0.12
METRES: Final = 0.9
POWER: Final = 2.2


class Solution(NamedTuple):
    """A pose of a square in the camera.

    Attributes:
        pose: Of the square.
        surprise: Sum of the squared residuals of its corners, in deviations.
    """

    pose: Pose
    surprise: float


class Square(NamedTuple):
    """A square that was seen.

    Attributes:
        solutions: One or two, best first.
        distance: From the camera, m.
        deviation: Of each coordinate of its rays.
    """

    solutions: tuple[Solution, ...]
    distance: float
    deviation: float


def solve(pixels: Array, rays: Array, size: float, lens: Lens) -> Square | None:
    """Return how a square may lie before the camera, or None if no square looks so.

    A small square looks nearly the same from two sides; both solutions are those of Collins and
    Bartoli, "Infinitesimal plane-based pose estimation" (IJCV 109, 2014).

    Args:
        pixels: (4, 2) its corners: bottom left, bottom right, top right, top left.
        rays: (4, 2) the same as rays.
        size: Its edge, m.
        lens: What it was seen through.
    """
    if not np.isfinite(rays).all():
        return None
    side = pixels[AFTER] - pixels
    after = side[AFTER]
    bent = side[:, 1] * after[:, 0] - side[:, 0] * after[:, 1]  # > 0 to the left: v points down
    if not (bent > 0).all():
        return None
    points = HALVES[::-1] * size  # from the top left, clockwise: what IPPE_SQUARE expects
    _, turns, places, misfits = cv2.solvePnPGeneric(
        points, np.ascontiguousarray(rays[::-1]), _STRAIGHT, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    found = [
        (Pose(_float(cv2.Rodrigues(turn)[0]), _float(place).ravel()), float(misfit))
        for turn, place, misfit in zip(turns, places, np.ravel(misfits), strict=True)
        if np.isfinite(turn).all() and np.isfinite(place).all()
    ]
    if not found:
        return None
    distance = float(np.linalg.norm(found[0][0].position))
    spread = deviation(distance, size) / float(lens.magnification(rays.mean(axis=0)))
    return Square(
        tuple(Solution(pose, rays.size * (misfit / spread) ** 2) for pose, misfit in found),
        distance,
        spread,
    )


def deviation(distance: float, size: float) -> float:
    """Return the deviation of each coordinate of a corner, px.

    A tag twice as large looks as one at half the distance does. It is more than the detector's own
    error, for it stands for what is wrong with the map and with the lens as well.

    Args:
        distance: From the camera, m.
        size: Edge of the tag, m.

    Example:
        >>> round(deviation(0.9, 0.168), 3)
        0.323
    """
    return math.hypot(LEAST, AT_METRES * (distance * 0.168 / size / METRES) ** POWER)


_STRAIGHT = np.eye(3)


def _float(given: object) -> Array:
    return np.asarray(given, np.float64)
