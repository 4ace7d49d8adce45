"""Footprints of cameras: what of the floor is in their images."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Final

import numpy as np

from star_core import Array, Camera
from star_core.toolkit import CameraModel, rotation_from_quaternion

MIN_HEIGHT: Final = 0.1  # m, of a camera whose footprint is drawn
SIDE: Final = 8  # segments along each edge of an image: the lens distorts it
MAX_DISTANCE: Final = 3.0  # m, up to which a footprint is drawn


def footprint(camera: Camera, position: Array, attitude: Array) -> Array:
    """Return the outline of the floor in a camera's image, (K, 3) in the map, m.

    Where the image shows the horizon, or floor beyond `MAX_DISTANCE`, the outline is at that
    distance; it is empty if the pose is unknown or at the floor, and ignores obstacles.

    Args:
        camera: The camera.
        position: (3,) of the agent, m.
        attitude: (4,) quaternion x, y, z, w from the body to the map.
    """
    if not (np.isfinite(position).all() and np.isfinite(attitude).all()):
        return np.zeros((0, 3))
    body = rotation_from_quaternion(attitude)
    eye = position + body @ np.array(camera.position)
    ray = _outline(camera) @ body.T
    across = np.linalg.norm(ray[:, :2], axis=1)
    with np.errstate(divide="ignore"):
        length = np.where(ray[:, 2] < 0, -eye[2] / ray[:, 2], np.inf)
        length = np.minimum(length, MAX_DISTANCE / across)
    floor = eye + length[:, None] * ray
    floor[:, 2] = 0.0
    near: Array = floor if eye[2] > MIN_HEIGHT else np.zeros((0, 3))
    return near


@cache
def _outline(camera: Camera) -> Array:
    """Return rays through the edges of an image, closed, (K, 3) in the body frame."""
    right, low = camera.width - 1.0, camera.height - 1.0
    corners = np.array([(0, 0), (right, 0), (right, low), (0, low), (0, 0)], float)
    share = np.arange(SIDE)[:, None] / SIDE
    pixels = np.concatenate([a + share * (b - a) for a, b in pairwise(corners)])
    model = CameraModel(camera)
    rays = model.undistort(pixels)
    rays = rays[np.isfinite(rays).all(axis=1)]
    rays = np.concatenate([rays, rays[:1]])
    ahead = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    outline: Array = ahead @ model.mounting.rotation.T
    return outline
