"""How a square tag lies before the camera, from its four corners: two answers."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, CameraModel, Pose, square_poses

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


def solve(rays: Array, size: float, lens: CameraModel) -> Square | None:
    """Return how a square may lie before the camera, or None if no square looks so.

    Args:
        rays: (4, 2) of its corners: bottom left, bottom right, top right, top left.
        size: Its edge, m.
        lens: What it was seen through.
    """
    found = square_poses(rays, size)
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
