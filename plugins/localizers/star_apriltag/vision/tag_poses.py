"""Poses from single tags: of the body from a tag of the map, of a target from the body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from star_apriltag.vision.body_pose import (
    LEVEL_STD,
    MAX_SURPRISE,
    Fix,
    Prediction,
    Verdict,
    View,
    judge,
    refine,
    surprise,
    tilt,
)
from star_core import Array, Pose, Tag
from star_core.toolkit import (
    CameraModel,
    rotation_from_quaternion,
    skew,
    square_corners,
    square_poses,
    upright_misfit,
)

MODULES: Final = 8  # per row of a tag of family 36h11, with its black border
CELLS: Final = MODULES + 2  # with its white border
USUAL_SIZE: Final = 0.168  # m, edge of the tag that figures by distance refer to

MAX_TILT: Final = math.radians(20.0)
"""Greatest angle between a solution's up and the on-board estimator's."""

TILT_STD: Final = math.radians(1.0) / 0.9**2  # rad per squared meter, of a solution's tilt

# Standard deviation of a corner, px: MIN_STD, and STD_AT for a tag of USUAL_SIZE at DISTANCE, which
# grows with that POWER of the distance. Fitted to simulated flights over a surveyed map.
MIN_STD: Final = 0.30
STD_AT: Final = 0.12
DISTANCE: Final = 0.9
POWER: Final = 2.2


class MapTag:
    """A tag of a landmark.

    Attributes:
        number: Of the tag.
        size: Edge of its black square, m.
        pose: In the map.
        corners: (4, 3) in the map, m: bottom left, bottom right, top right and top left.
        outline: (4, 3) the same of the white border around it, in the tag's own frame.
    """

    def __init__(self, tag: Tag) -> None:
        self.number = tag.id
        self.size = tag.size
        self.pose = Pose(rotation_from_quaternion(tag.rotation), np.array(tag.position))
        self.corners = self.pose.apply(square_corners(tag.size))
        self.outline = square_corners(tag.size) * CELLS / MODULES


class Square(NamedTuple):
    """Possible poses of a square in the camera."""

    # one or two poses, best first, each with the sum of the squared residuals of its corners,
    # in standard deviations
    solutions: tuple[tuple[Pose, float], ...]
    distance: float  # from the camera, m
    deviation: float  # standard deviation of each coordinate of its rays


@dataclass(frozen=True, slots=True)
class SeenLandmark:
    """A tag of the map in one image."""

    tag: int  # its number
    verdict: Verdict  # whether it is used
    view: View | None = None  # its corners as a measurement; None if no pose fits
    distance: float = math.nan  # from the camera to its center, m; NaN if no pose fits
    surprise: float = math.nan  # of its fix against the prediction; NaN without a fix
    fix: Fix | None = None  # of the body, from this tag alone with the on-board tilt and height


@dataclass(frozen=True, slots=True)
class SeenTarget:
    """A tag of a target in one image."""

    tag: int  # its number
    pose: Pose  # in the body
    # (3, 3) of its position in the body frame, m², without that of the body's pose
    covariance: Array


def seen_landmark(
    tag: MapTag, pixels: Array, rays: Array, lens: CameraModel, prediction: Prediction
) -> SeenLandmark:
    """Return the body's pose by a tag of the map, with (4, 2) corners in px and as rays."""
    square = solve(rays, tag.size, lens)
    if square is None:
        return SeenLandmark(tag.number, Verdict.UNSOLVED)
    view = View(tag.corners, rays, square.deviation, lens.row_delay(pixels))
    camera = prediction.camera(lens.mounting)
    pose = _likeliest(square, tag, camera, prediction)
    if pose is None:
        return SeenLandmark(tag.number, Verdict.TILTED, view, square.distance)
    fix = refine(pose, [view], camera, prediction.pose, prediction.motion)
    if fix is None:
        return SeenLandmark(tag.number, Verdict.UNSOLVED, view, square.distance)
    verdict, far = judge(fix, square.distance, prediction.pose, prediction.covariance)
    return SeenLandmark(tag.number, verdict, view, square.distance, far, fix)


def joint_fix(
    landmarks: Sequence[SeenLandmark], lens: CameraModel, prediction: Prediction
) -> Fix | None:
    """Return the body's pose from several tags of one image, or None if there is none."""
    solved = [(s.fix, s.view) for s in landmarks if s.fix is not None and s.view is not None]
    if len(solved) <= 1:
        return solved[0][0] if solved else None
    best = min((fix for fix, _ in solved), key=lambda fix: float(np.trace(fix.covariance)))
    views = [view for _, view in solved]
    camera = prediction.camera(lens.mounting)
    return refine(best.pose, views, camera, prediction.pose, prediction.motion)


def seen_target(
    tag: int, size: float, pixels: Array, rays: Array, lens: CameraModel, prediction: Prediction
) -> SeenTarget | None:
    """Return a target's pose in the body, by its edge, m, and (4, 2) corners in px and as rays.

    None if no pose fits.
    """
    square = solve(rays, size, lens)
    if square is None:
        return None
    camera = prediction.camera(lens.mounting)
    up = prediction.pose.rotation[2] @ camera.rotation
    best, _ = min(
        square.solutions, key=lambda solution: upright_misfit(solution[0], solution[1], up)
    )
    view = View(square_corners(size), rays, square.deviation, lens.row_delay(pixels))
    fix = refine((camera @ best).inverse(), [view], camera, motion=prediction.motion)
    if fix is None:
        return None
    pose = fix.pose.inverse()
    shift = np.hstack([skew(pose.position), -np.eye(3)])  # of the tag, by a step of the body
    return SeenTarget(tag, pose, shift @ fix.covariance @ shift.T)


def solve(rays: Array, size: float, lens: CameraModel) -> Square | None:
    """Return the possible poses of a square in the camera, by its (4, 2) rays and its edge, m."""
    solutions = square_poses(rays, size)
    if not solutions:
        return None
    distance = float(np.linalg.norm(solutions[0][0].position))
    spread = corner_std(distance, size) / float(lens.magnification(rays.mean(axis=0)))
    return Square(
        tuple((pose, rays.size * (misfit / spread) ** 2) for pose, misfit in solutions),
        distance,
        spread,
    )


def corner_std(distance: float, size: float) -> float:
    """Return the standard deviation of each coordinate of a corner, px.

    A tag twice as large looks like one at half the distance. It is more than the detector's own
    error, since it includes errors of the map and of the lens. `size` is its edge, m.

    Example:
        >>> round(corner_std(0.9, 0.168), 3)
        0.323
    """
    return math.hypot(MIN_STD, STD_AT * (distance * USUAL_SIZE / size / DISTANCE) ** POWER)


def _likeliest(square: Square, tag: MapTag, camera: Pose, prediction: Prediction) -> Pose | None:
    """Return the likelier body pose of those that are level enough, or None if none is.

    The on-board tilt separates the two solutions of a tag on the floor; those of a tag on a wall,
    which differ in yaw, only the prediction does. Its weight is limited to that of the gate, so
    that an agent far from the predicted pose is still located.
    """
    up = prediction.pose.rotation[2]
    meters = square.distance * USUAL_SIZE / tag.size
    spread = math.hypot(LEVEL_STD, TILT_STD * meters**2)
    best, least = None, math.inf
    for solution, misfit in square.solutions:
        pose = tag.pose @ solution.inverse() @ camera.inverse()
        angle = tilt(pose, up)
        if not angle <= MAX_TILT:
            continue
        far = surprise(pose, square.distance, prediction.pose, prediction.covariance)
        cost = misfit + (angle / spread) ** 2 + min(far, MAX_SURPRISE)
        if cost < least:
            best, least = pose, cost
    return best
