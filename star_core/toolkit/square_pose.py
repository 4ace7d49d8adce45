"""Pose of a square of known size in front of a camera, from its four corners."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core.messages.arrays import Array
from star_core.messages.rotations import Pose

_UNIT: Final = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])

_NEXT: Final = [1, 2, 3, 0]


def square_corners(size: float) -> Array:
    """Return a tag's corners in its own frame: bottom left, bottom right, top right, top left.

    Args:
        size: Its edge, m.

    Returns:
        (4, 3) m.
    """
    corners: Array = _UNIT * size
    return corners


def square_poses(rays: Array, size: float) -> list[tuple[Pose, float]]:
    """Return the possible poses of a square in a camera's frame: up to two, the better one first.

    A small square looks nearly the same in two poses, those of Collins and Bartoli, "Infinitesimal
    plane-based pose estimation" (IJCV 109, 2014), by OpenCV. For some exact corners, as of a square
    parallel to the image plane, OpenCV's are wrong by up to 2 cm.

    Args:
        rays: (4, 2) x / z and y / z of its corners, in the order of `square_corners`.
        size: Its edge, m.

    Returns:
        Each pose of the square in the camera's frame, with the root mean square of its residuals in
        the units of `rays`; none if the corners are not those of a square seen from the front.
    """
    import cv2  # a flight without images or targets does not

    side = rays[_NEXT] - rays
    after = side[_NEXT]
    convex = side[:, 1] * after[:, 0] - side[:, 0] * after[:, 1] > 0  # turns left: y points down
    if not (convex.all() and np.isfinite(rays).all()):
        return []
    points = square_corners(size)[::-1]  # from the top left, clockwise: what IPPE_SQUARE expects
    _, rotations, positions, residuals = cv2.solvePnPGeneric(
        points, np.ascontiguousarray(rays[::-1]), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    return [
        (Pose(_float(cv2.Rodrigues(rotation)[0]), _float(position).ravel()), float(residual))
        for rotation, position, residual in zip(
            rotations,
            positions,
            np.ravel(residuals),
            strict=False,  # there may be residuals without poses
        )
        if np.isfinite(rotation).all() and np.isfinite(position).all()
    ]


def _float(given: object) -> Array:
    return np.asarray(given, np.float64)
