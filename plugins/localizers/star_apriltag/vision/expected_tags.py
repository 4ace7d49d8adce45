"""Tags of the map that should be in an image, and their expected pixels."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_apriltag.vision.body_pose import HEIGHT_STD, MIN_DEPTH, Prediction
from star_apriltag.vision.perspective import perspective
from star_apriltag.vision.tag_poses import USUAL_SIZE, MapTag
from star_core import Array, Pose
from star_core.toolkit import CameraModel, skew

MAX_DISTANCE: Final = 3.0
"""Of a tag of `USUAL_SIZE`, m. On the floor, seen from 0.8 m above it, its code fills about thirty
pixels then."""

MIN_SLANT: Final = 0.15  # cosine between a tag's normal and the direction to the camera
MAX_TAGS: Final = 6  # of an image, which bounds the time

TURN_STD: Final = math.radians(1.0)
"""Of tilt and the camera's mounting together, about each axis, rad. It is less than `LEVEL_STD`,
which is large because errors last; for one image they do not."""


@dataclass(frozen=True, slots=True)
class ExpectedTag:
    """A tag as it should be seen."""

    tag: MapTag  # of the map
    pose: Pose  # in the camera, when the row of its center is read
    pixel: Array  # (2,) its center, px
    covariance: Array  # (2, 2) of that, px²
    distance: float  # from the camera to its center, m


class ExpectedTags:
    """Predicts which tags of the map are in the images of one camera."""

    def __init__(self, lens: CameraModel, tags: Sequence[MapTag]) -> None:
        self._lens = lens
        self._tags = tuple(tags)
        self._numbers = np.array([tag.number for tag in tags], np.int64)
        self._centers = np.array([tag.pose.position for tag in tags]).reshape(-1, 3)
        self._normals = np.array([tag.pose.rotation[:, 2] for tag in tags]).reshape(-1, 3)
        self._reach = np.array([MAX_DISTANCE * tag.size / USUAL_SIZE for tag in tags])

    def expect(self, prediction: Prediction, exclude: Collection[int] = ()) -> list[ExpectedTag]:
        """Return the nearest tags whose faces should be seen, nearest first.

        Args:
            prediction: Of the body when the image was taken.
            exclude: Numbers of tags to leave out.
        """
        camera = prediction.pose @ prediction.camera(self._lens.mounting)
        away = self._centers - camera.position
        ahead = away @ camera.rotation
        distance = np.sqrt((away * away).sum(axis=1))
        facing = -(away * self._normals).sum(axis=1) >= MIN_SLANT * distance
        in_view = (distance <= self._reach) & facing & (ahead[:, 2] > MIN_DEPTH)
        rows = np.flatnonzero(in_view & ~np.isin(self._numbers, list(exclude)))
        pixels = self._lens.project(ahead[rows])
        inside = ((pixels >= 0) & (pixels < self._lens.shape[::-1])).all(axis=1)
        nearest = sorted(np.flatnonzero(inside).tolist(), key=lambda k: distance[rows[k]])
        candidates = [
            self._expected_tag(self._tags[rows[k]], pixels[k], prediction)
            for k in nearest[:MAX_TAGS]
        ]
        return [expected for expected in candidates if expected is not None]

    def _expected_tag(
        self, tag: MapTag, pixel: Array, prediction: Prediction
    ) -> ExpectedTag | None:
        """Return a tag as it should be seen, with a row of about that of (2,) `pixel`."""
        lens, mounting = self._lens, prediction.camera(self._lens.mounting)
        moving = np.concatenate([prediction.motion.rates, prediction.motion.velocity])
        body = prediction.pose.moved(float(lens.row_delay(pixel)) * moving)
        pose = (body @ mounting).inverse() @ tag.pose
        if not (pose.position[2] > MIN_DEPTH and lens.in_reach(pose.position)):
            return None
        ray, by_camera = perspective(pose.position)
        by_camera *= float(lens.magnification(ray))
        by_body = np.hstack([skew(mounting.apply(pose.position)), -np.eye(3)])
        by_step = by_camera @ mounting.rotation.T @ by_body
        covariance = by_step @ _spread(prediction) @ by_step.T
        pixel = lens.project(pose.position)
        return ExpectedTag(tag, pose, pixel, covariance, math.hypot(*pose.position))


def _spread(prediction: Prediction) -> Array:
    """Return the (6, 6) covariance of a rotation and then a shift of the body in its own frame."""
    rotation = prediction.pose.rotation
    by_map = np.zeros((6, 3))  # of x, y and yaw
    by_map[3:, :2] = rotation[:2].T
    by_map[:3, 2] = rotation[2]
    covariance: Array = by_map @ prediction.covariance @ by_map.T
    covariance[:3, :3] += TURN_STD**2 * np.eye(3)
    covariance[3:, 3:] += HEIGHT_STD**2 * np.outer(rotation[2], rotation[2])
    return covariance
