"""Where a square of known size lies in front of a camera, and how sure that is."""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np

from star_core import Array, Pose, square_corners, square_poses

MOST_MISFIT: Final = (
    3.0  # standard deviations of a corner, root mean square, at which it still fits
)
LYING: Final = 6.0  # squared deviations by which the corners must favor an upright square

_NUDGES: Final = 1e-6 * np.arange(8.0).reshape(4, 2) ** 2
"""By which corners are moved for a second guess: some exact ones have no good first one."""


class LastKnownTransform(NamedTuple):
    """How a square lies in the camera's frame.

    Attributes:
        pose: Of the square in the camera.
        covariance: (3, 3) of its position, m².
        surprise: Sum of the squared residuals of its corners, in standard deviations.
    """

    pose: Pose
    covariance: Array
    surprise: float


def lying(rays: Array, size: float, up: Array, deviation: float) -> LastKnownTransform | None:
    """Return how a square lies whose corners are seen, or None if no square looks so.

    It is the pose with the least squared residuals. Of the two that a small square may have, a
    level one, as of a sheet on the floor, is preferred.

    Args:
        rays: (4, 2) x / z and y / z of its corners: bottom left, bottom right, top right, top left.
        size: Its edge, m.
        up: (3,) unit vector against gravity in the camera's frame.
        deviation: Standard deviation of each coordinate of the rays.
    """
    guesses = square_poses(rays, size) + square_poses(rays + _NUDGES, size)
    found = [one for pose, _ in guesses if (one := _refined(pose, rays, size, deviation))]
    return min(
        found, key=lambda one: one.surprise - LYING * one.pose.rotation[:, 2] @ up, default=None
    )


def _refined(pose: Pose, rays: Array, size: float, deviation: float) -> LastKnownTransform | None:
    """Return the pose near a first one that fits best, or None if it does not fit."""
    points, straight = square_corners(size), np.eye(3)
    turn, place = cv2.solvePnPRefineLM(
        points, rays, straight, None, cv2.Rodrigues(pose.rotation)[0], pose.position[:, None]
    )
    seen, by_pose = cv2.projectPoints(points, turn, place, straight, None)
    off = (rays - np.asarray(seen, np.float64).reshape(4, 2)).ravel()
    surprise = float(off @ off) / deviation**2
    rows = np.asarray(by_pose, np.float64)[:, :6]  # by the rotation vector, then by the position
    if not (surprise <= len(off) * MOST_MISFIT**2 and place[2] > size / 2):
        return None
    try:
        covariance = np.asarray(np.linalg.inv(rows.T @ rows)[3:, 3:] * deviation**2, np.float64)
    except np.linalg.LinAlgError:  # seen from its edge
        return None
    rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
    return LastKnownTransform(
        Pose(rotation, np.asarray(place, np.float64).ravel()), covariance, surprise
    )
