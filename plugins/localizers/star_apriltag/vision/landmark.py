"""A tag of the map in one image: where it says that the body is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_apriltag.vision.body_pose import LEVEL_DEVIATION, Fix, View, refine
from star_apriltag.vision.gate import MOST_SURPRISE, Verdict, judge, surprise, tilt
from star_apriltag.vision.prediction import Prediction
from star_apriltag.vision.square import Square, solve
from star_core import Array, CameraModel, Pose, Tag, rotation_from_quaternion, square_corners

MODULES: Final = 8  # of a tag of family 36h11 along one side, its black border included
CELLS: Final = MODULES + 2  # with its white rim

MOST_TILT: Final = math.radians(20.0)
"""Angle between a solution's up and the on-board estimator's past which it is no candidate."""

TILT_DEVIATION: Final = math.radians(1.0) / 0.9**2
"""Of a solution's tilt, rad for a metre of distance squared, with a tag of 0.168 m."""


class Place:
    """A landmark's tag where the map has it.

    Args:
        tag: As the scene has it.

    Attributes:
        tag: Its number.
        size: Edge of its black square, m.
        pose: In the map.
        corners: (4, 3) in the map, m: bottom left, bottom right, top right and top left.
        outline: (4, 3) the same of the white rim around it, in the tag's own frame.
    """

    def __init__(self, tag: Tag) -> None:
        self.tag = tag.id
        self.size = tag.size
        self.pose = Pose(rotation_from_quaternion(tag.rotation), np.array(tag.position))
        self.corners = self.pose.apply(square_corners(tag.size))
        self.outline = square_corners(tag.size) * CELLS / MODULES


@dataclass(frozen=True, slots=True)
class SeenLandmark:
    """A tag of the map in one image.

    Attributes:
        tag: Its number.
        pixels: (4, 2) its corners, px: bottom left, bottom right, top right and top left.
        view: The same as a measurement; None where no pose fits.
        distance: From the camera to its centre, m; NaN where no pose fits.
        verdict: Whether it is to be believed.
        surprise: Squared deviations of its fix from the prediction; NaN where there is none.
        fix: Of the body, from this tag alone with the on-board tilt and height.
    """

    tag: int
    pixels: Array
    verdict: Verdict
    view: View | None = None
    distance: float = math.nan
    surprise: float = math.nan
    fix: Fix | None = None


def seen_landmark(
    place: Place, pixels: Array, rays: Array, lens: CameraModel, prediction: Prediction
) -> SeenLandmark:
    """Return what a tag of the map says about the body, and whether it is to be believed.

    Args:
        place: Where the map has it.
        pixels: (4, 2) its corners, px.
        rays: (4, 2) the same as rays.
        lens: What it was seen through.
        prediction: Of the body.
    """
    square = solve(rays, place.size, lens)
    if square is None:
        return SeenLandmark(place.tag, pixels, Verdict.UNSOLVED)
    view = View(place.corners, rays, square.deviation, lens.row_delay(pixels))
    camera = prediction.camera(lens.mounting)
    pose = _likeliest(square, place, camera, prediction)
    if pose is None:
        return SeenLandmark(place.tag, pixels, Verdict.TILTED, view, square.distance)
    fix = refine(pose, [view], camera, prediction.level, prediction.motion)
    if fix is None:
        return SeenLandmark(place.tag, pixels, Verdict.UNSOLVED, view, square.distance)
    verdict, far = judge(fix, square.distance, prediction.pose, prediction.covariance)
    return SeenLandmark(place.tag, pixels, verdict, view, square.distance, far, fix)


def together(seen: Sequence[SeenLandmark], lens: CameraModel, prediction: Prediction) -> Fix | None:
    """Return the body's pose from several tags of one image, or None if there is none."""
    solved = [(s.fix, s.view) for s in seen if s.fix is not None and s.view is not None]
    if len(solved) == 1:
        return solved[0][0]
    if not solved:
        return None
    surest = min((fix for fix, _ in solved), key=lambda fix: float(np.trace(fix.covariance)))
    views = [view for _, view in solved]
    camera = prediction.camera(lens.mounting)
    return refine(surest.pose, views, camera, prediction.level, prediction.motion)


def _likeliest(square: Square, place: Place, camera: Pose, prediction: Prediction) -> Pose | None:
    """Return the likelier body pose of those that are level enough, or None if none is.

    Up tells the two solutions of a tag on the floor apart; those of a tag on a wall, which differ
    in yaw, only the prediction does. It counts no more than the gate would, so that an agent that
    is somewhere else altogether is still found.
    """
    up = prediction.level.up
    metres = square.distance * 0.168 / place.size
    spread = math.hypot(LEVEL_DEVIATION, TILT_DEVIATION * metres**2)
    best, least = None, math.inf
    for solution in square.solutions:
        pose = place.pose @ solution.pose.inverse() @ camera.inverse()
        angle = tilt(pose, up)
        if not angle <= MOST_TILT:
            continue
        far = surprise(pose, square.distance, prediction.pose, prediction.covariance)
        cost = solution.surprise + (angle / spread) ** 2 + min(far, MOST_SURPRISE)
        if cost < least:
            best, least = pose, cost
    return best
