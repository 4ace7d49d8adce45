"""A painter of tags as a camera sees them, and corners without an image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from star_apriltag.vision.body_pose import Prediction
from star_core import Array, Camera, Image, Pose, Tag
from star_core.toolkit import CameraModel, rotation_from_quaternion, square_corners
from star_core.world.quaternions import turned

FINE = 4  # by which images are painted larger than they are, along each side
BLUR, NOISE = 0.7, 4.0  # px and grey values
INK, PAPER, FLOOR = 35.0, 205.0, 115.0

LENS = CameraModel(Camera())


def turned_model(extra: Array, camera: Camera | None = None) -> CameraModel:
    """Returns the model of a camera that is turned against its mounting, in its own frame."""
    camera = camera or Camera()
    level = CameraModel(Camera(pitch=0.0)).mounting.rotation  # looks straight ahead
    turned = CameraModel(camera).mounting.rotation @ extra @ level.T
    roll, pitch, yaw = Rotation.from_matrix(turned).as_euler("xyz").tolist()
    return CameraModel(replace(camera, roll=roll, pitch=pitch, yaw=yaw))


@cache
def fine_rays() -> Array:
    """Return the rays of the default camera's fine pixels, (FINE H, FINE W, 3)."""
    height, width = LENS.shape
    v, u = np.mgrid[: height * FINE, : width * FINE]
    pixels = (np.stack([u, v], axis=-1) + 0.5) / FINE - 0.5
    return np.dstack([LENS.undistort(pixels), np.ones(u.shape)])


def paint(body: Pose, tags: Sequence[Tag]) -> Image:
    """Return what the default camera sees of tags with their white rims, on a plain floor."""
    rays, family = fine_rays(), cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    camera = body @ LENS.mounting
    image = np.full(rays.shape[:2], FLOOR)
    for tag in tags:
        bits = cv2.aruco.generateImageMarker(family, tag.id, 8) > 0
        bits = np.pad(bits, 1, constant_values=True)
        to_tag = in_map(tag).inverse() @ camera
        ahead = rays @ to_tag.rotation.T
        times = -to_tag.position[2] / ahead[..., 2]
        x, y = ((to_tag.position[i] + times * ahead[..., i]) / tag.size * 8 for i in (0, 1))
        inside = (np.abs(x) < 5) & (np.abs(y) < 5) & (times > 0)
        row, column = np.floor(5 - y[inside]).astype(int), np.floor(x[inside] + 5).astype(int)
        image[inside] = np.where(bits[row, column], PAPER, INK)
    height, width = LENS.shape
    image = cv2.GaussianBlur(image, (0, 0), BLUR * FINE)
    image = image.reshape(height, FINE, width, FINE).mean(axis=(1, 3))
    noise = np.random.default_rng(len(tags)).normal(0, NOISE, image.shape)
    taken: Image = np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)
    return taken


def in_map(tag: Tag) -> Pose:
    return Pose(rotation_from_quaternion(tag.rotation), np.array(tag.position))


def on_floor(number: int, x: float, y: float, yaw: float = 0.0, size: float = 0.168) -> Tag:
    return Tag(number, size, (x, y, 0.0), turned(0, 0, yaw), "here")


def on_wall(number: int, x: float, y: float, z: float, facing: float) -> Tag:
    """Upright; its normal points along `facing`, rad."""
    return Tag(number, 0.168, (x, y, z), turned(math.pi / 2, 0, facing + math.pi / 2), "here")


def hovering(
    x: float = 0.0, y: float = 0.0, yaw: float = 0.0, roll: float = 0.0, pitch: float = 0.0
) -> Pose:
    return Pose(rotation_from_quaternion(turned(roll, pitch, yaw)), np.array([x, y, 0.8]))


def tag_corners(body: Pose, tag: Tag, lens: CameraModel = LENS) -> Array | None:
    """Returns the (4, 2) corners of a tag, or None if it is not wholly in the image."""
    camera = (body @ lens.mounting).inverse().apply(in_map(tag).apply(square_corners(tag.size)))
    if camera[:, 2].min() < 0.1:
        return None
    pixels = lens.project(camera)
    inside = (pixels > 4).all() and (pixels < np.array(lens.shape[::-1]) - 5).all()
    return pixels if inside else None


def predicted(body: Pose, deviation: float = 0.1, yaw_deviation: float = 0.07) -> Prediction:
    """Returns a prediction that is right."""
    covariance = np.diag([deviation, deviation, yaw_deviation]) ** 2
    return Prediction(pose=body, covariance=covariance)
