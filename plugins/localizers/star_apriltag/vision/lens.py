"""A camera's lens and mounting: from the image to directions in the body, and back."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from star_apriltag.vision.rigid import Pose, matrix
from star_core import Array, Camera, Image

ENOUGH: Final = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 1e-7)
"""When to stop undistorting a point: after 30 steps, or at 1e-7 px."""

WIDEST: Final = 4.0  # 76 degrees off the axis, further than a pinhole model serves
SAFE: Final = 0.98  # of the radius at which the model folds back: beyond, it hardly converges


class Lens:
    """OpenCV's pinhole model with radial and tangential distortion.

    A ray is the direction x / z, y / z in the camera's frame: what the image would show with a
    focal length of 1 and no distortion.

    Args:
        camera: As the scene has it.

    Attributes:
        shape: Height and width of its images, px.
        matrix: (3, 3) of intrinsics, px.
        distortion: (5,) k1, k2, p1, p2, k3.
        mounting: Where the camera lies in the body.
    """

    def __init__(self, camera: Camera) -> None:
        fx, fy, cx, cy = camera.matrix
        self.shape = (camera.height, camera.width)
        self.matrix: Array = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        self.distortion: Array = np.array(camera.distortion)
        self.mounting = Pose(matrix(camera.rotation), np.array(camera.position))
        self._readout = camera.readout
        self._reach = _reach(self.distortion)

    def checked(self, image: Image) -> Image:
        """Return an image whose rows lie one after the other in memory.

        Raises:
            ValueError: It is no grey image of the camera's size.
        """
        if image.shape != self.shape or image.dtype != np.uint8:
            raise ValueError(
                f"image is {image.shape!r} of {image.dtype}, expected {self.shape!r} of uint8"
            )
        return np.ascontiguousarray(image)

    def undistort(self, pixels: Array) -> Array:
        """Return the (..., 2) rays that (..., 2) pixels show, NaN where the model has none.

        Barrel distortion, as a polynomial, folds back: no ray is seen beyond some radius.
        """
        flat = np.ascontiguousarray(pixels, np.float64).reshape(-1, 1, 2)
        if not len(flat):
            return np.zeros(pixels.shape)
        rays = cv2.undistortPoints(flat, self.matrix, self.distortion, criteria=ENOUGH)
        off = (flat - self.matrix[:2, 2]) / self.matrix.diagonal()[:2]
        known = (off * off).sum(axis=-1, keepdims=True) < self._reach**2
        return np.where(known, rays, np.nan).reshape(pixels.shape)

    def project(self, points: Array) -> Array:
        """Return the (..., 2) pixels at which (..., 3) points in the camera's frame are seen.

        Points must lie ahead of the camera.
        """
        x, y = (points[..., :2] / points[..., 2:]).reshape(-1, 2).T
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        (fx, _, cx), (_, fy, cy), _ = self.matrix
        pixels: Array = np.stack([fx * u + cx, fy * v + cy], axis=-1)
        return pixels.reshape(*points.shape[:-1], 2)

    @cached_property
    def rays(self) -> NDArray[np.float32]:
        """The (height, width, 2) rays that the image's pixels show."""
        v, u = np.mgrid[: self.shape[0], : self.shape[1]]
        return self.undistort(np.stack([u, v], axis=-1)).astype(np.float32)

    def magnification(self, rays: Array) -> Array:
        """Return how many pixels one unit of a ray is worth at (..., 2) rays: (...,).

        It is the geometric mean over the directions, with the radial distortion only: towards the
        corners of a wide image a pixel covers more.
        """
        k1, k2, _, _, k3 = self.distortion
        r2 = (rays * rays).sum(axis=-1)
        around = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        along = 1 + r2 * (3 * k1 + r2 * (5 * k2 + r2 * 7 * k3))
        focal = self.matrix[0, 0] * self.matrix[1, 1]
        scale: Array = np.sqrt(focal * np.maximum(around * along, 0.01))
        return scale

    def delay(self, pixels: Array) -> Array:
        """Return when the rows of (..., 2) pixels were read, from the middle row on, s: (...,)."""
        rows = self.shape[0] - 1
        late: Array = (pixels[..., 1] / rows - 0.5) * self._readout
        return late


def _reach(distortion: Array) -> float:
    """Return the distorted radius up to which there is one ray to a pixel."""
    k1, k2, _, _, k3 = distortion
    radius = np.linspace(0.0, WIDEST, 1000)
    r2 = radius**2
    distorted = radius * (1 + r2 * (k1 + r2 * (k2 + r2 * k3)))
    back = np.flatnonzero(np.diff(distorted) <= 0)
    return SAFE * float(distorted[back[0]]) if len(back) else math.inf
