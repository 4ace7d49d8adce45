"""Which tags of the map should be in an image, and where."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_apriltag.vision.body_pose import HEIGHT_DEVIATION, NEAREST
from star_apriltag.vision.landmark import Place
from star_apriltag.vision.prediction import Prediction
from star_core import Array, CameraModel, Pose, perspective, skew

FARTHEST: Final = 3.0
"""How far away a tag of 0.168 m may be, m. On the floor, seen from 0.8 m above it, its code fills
about thirty pixels then."""

LEAST_SLANT: Final = 0.15  # cosine between a tag's normal and the way to the camera
MOST: Final = 6  # tags of an image, so that it does not take long

TURN_DEVIATION: Final = math.radians(1.0)
"""What tilt and the camera's mounting are good for together, about each axis, rad. It is less than
`LEVEL_DEVIATION`, which is loose because errors last; for one image they do not."""


@dataclass(frozen=True, slots=True)
class Expected:
    """How a tag should be seen.

    Attributes:
        place: In the map.
        tag: In the camera, when the row of its centre is read.
        pixel: (2,) its centre, px.
        covariance: (2, 2) of that, px².
        distance: From the camera to its centre, m.
    """

    place: Place
    tag: Pose
    pixel: Array
    covariance: Array
    distance: float


class Foresight:
    """Says which tags should be in the images of one camera.

    Args:
        lens: Of the camera.
        places: The map.
    """

    def __init__(self, lens: CameraModel, places: Sequence[Place]) -> None:
        self._lens = lens
        self._places = tuple(places)
        self._numbers = np.array([place.tag for place in places], np.int64)
        self._centres = np.array([place.pose.position for place in places]).reshape(-1, 3)
        self._normals = np.array([place.pose.rotation[:, 2] for place in places]).reshape(-1, 3)
        self._reach = np.array([FARTHEST * place.size / 0.168 for place in places])

    def expect(self, prediction: Prediction, passed_over: Collection[int] = ()) -> list[Expected]:
        """Return the nearest tags whose faces should be seen, nearest first.

        Args:
            prediction: Of the body when the image was taken.
            passed_over: Numbers of tags that do not matter.
        """
        camera = prediction.pose @ prediction.camera(self._lens.mounting)
        away = self._centres - camera.position
        ahead = away @ camera.rotation
        distance = np.sqrt((away * away).sum(axis=1))
        facing = -(away * self._normals).sum(axis=1) >= LEAST_SLANT * distance
        there = (distance <= self._reach) & facing & (ahead[:, 2] > NEAREST)
        rows = np.flatnonzero(there & ~np.isin(self._numbers, list(passed_over)))
        pixels = self._lens.project(ahead[rows])
        inside = ((pixels >= 0) & (pixels < self._lens.shape[::-1])).all(axis=1)
        nearest = sorted(np.flatnonzero(inside).tolist(), key=lambda k: distance[rows[k]])[:MOST]
        seen = [self._seen(self._places[rows[k]], pixels[k], prediction) for k in nearest]
        return [expected for expected in seen if expected is not None]

    def _seen(self, place: Place, pixel: Array, prediction: Prediction) -> Expected | None:
        """Return how a tag should be seen whose row is about that of (2,) `pixel`."""
        lens, mounting = self._lens, prediction.camera(self._lens.mounting)
        moving = np.concatenate([prediction.rates, prediction.velocity])
        body = prediction.pose.moved(float(lens.row_delay(pixel)) * moving)
        tag = (body @ mounting).inverse() @ place.pose
        if not (tag.position[2] > NEAREST and lens.in_reach(tag.position)):
            return None
        pixel = lens.project(tag.position)
        ray, by_camera = perspective(tag.position)
        by_camera *= float(lens.magnification(ray))
        by_body = np.hstack([skew(mounting.apply(tag.position)), -np.eye(3)])
        by_step = by_camera @ mounting.rotation.T @ by_body
        covariance = by_step @ _spread(prediction) @ by_step.T
        return Expected(place, tag, pixel, covariance, math.hypot(*tag.position))


def _spread(prediction: Prediction) -> Array:
    """The (6, 6) covariance of a turn and then a shift of the body in its own frame."""
    rotation = prediction.pose.rotation
    by_map = np.zeros((6, 3))  # of x, y and yaw
    by_map[3:, :2] = rotation[:2].T
    by_map[:3, 2] = rotation[2]
    covariance: Array = by_map @ prediction.covariance @ by_map.T
    covariance[:3, :3] += TURN_DEVIATION**2 * np.eye(3)
    covariance[3:, 3:] += HEIGHT_DEVIATION**2 * np.outer(rotation[2], rotation[2])
    return covariance
