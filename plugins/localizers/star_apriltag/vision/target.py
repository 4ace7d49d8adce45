"""A tag to be found in one image: where it lies before the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from star_apriltag.vision.body_pose import View, refine
from star_apriltag.vision.prediction import Prediction
from star_apriltag.vision.square import Solution, solve
from star_core import Array, CameraModel, Pose, skew, square_corners

LYING: Final = 6.0
"""Squared deviations by which the image must speak for a target that hangs on a wall against one
that lies on the floor. Where a camera looks down at 45°, one may look like the other."""


@dataclass(frozen=True, slots=True)
class SeenTarget:
    """A tag to be found, in one image.

    Attributes:
        tag: Its number.
        pixels: (4, 2) its corners, px: bottom left, bottom right, top right and top left.
        pose: In the body.
        covariance: (3, 3) of its position in the body frame, m²; the body's own is not in it.
        distance: From the camera to its centre, m.
    """

    tag: int
    pixels: Array
    pose: Pose
    covariance: Array
    distance: float


def seen_target(
    tag: int, size: float, pixels: Array, rays: Array, lens: CameraModel, prediction: Prediction
) -> SeenTarget | None:
    """Return where a tag lies before the body, or None if no pose fits its corners.

    Args:
        tag: Its number.
        size: Its edge, m.
        pixels: (4, 2) its corners, px.
        rays: (4, 2) the same as rays.
        lens: What it was seen through.
        prediction: Of the body.
    """
    square = solve(rays, size, lens)
    if square is None:
        return None
    camera = prediction.camera(lens.mounting)
    up = prediction.level.up

    def cost(solution: Solution) -> float:
        normal = (camera.rotation @ solution.pose.rotation)[:, 2]
        return solution.surprise + LYING * float(1 - up @ normal)

    tag_in_body = camera @ min(square.solutions, key=cost).pose
    view = View(square_corners(size), rays, square.deviation, lens.row_delay(pixels))
    fix = refine(tag_in_body.inverse(), [view], camera, motion=prediction.motion)
    if fix is None:
        return None
    pose = fix.pose.inverse()
    shift = np.hstack([skew(pose.position), -np.eye(3)])  # of the tag, by a step of the body
    return SeenTarget(tag, pixels, pose, shift @ fix.covariance @ shift.T, square.distance)
