"""How a square tag lies before the camera, from the homography of its corners: one answer."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Array, Pose, square_corners

SINGULAR: Final = 1e-9


def flat_pose(rays: Array, size: float) -> Pose | None:
    """Return the pose of a square in the camera, or None if no plane in front looks so.

    Four corners give the homography from the square's plane to the image. Up to a factor, it is the
    first two columns of the rotation and the place. The factor makes those columns as long as 1 in
    the geometric mean; with their cross product, the nearest rotation is taken. Nothing weighs the
    errors of the corners, and of the two poses that a small square looks like either may come out.

    Args:
        rays: (4, 2) its corners: bottom left, bottom right, top right, top left.
        size: Its edge, m.
    """
    if not np.isfinite(rays).all():
        return None
    x, y = square_corners(size)[:, :2].T
    u, v = rays.T
    one, zero = np.ones(4), np.zeros(4)
    rows = np.concatenate(
        [
            np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=1),
            np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=1),
        ]
    )
    homography = np.linalg.svd(rows)[2][-1].reshape(3, 3)
    if abs(np.linalg.det(homography)) < SINGULAR or abs(homography[2, 2]) < SINGULAR:
        return None
    length = math.sqrt(float(np.prod(np.linalg.norm(homography[:, :2], axis=0))))
    right, up, place = (homography / math.copysign(length, homography[2, 2])).T
    before, _, after = np.linalg.svd(np.column_stack([right, up, np.cross(right, up)]))
    return Pose(before @ after, place)
