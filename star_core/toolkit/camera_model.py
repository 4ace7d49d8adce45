"""A camera's projection, with OpenCV's pinhole model, and the poses of squares by it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from star_core.messages.arrays import Array, Mask
from star_core.messages.rotations import Pose, rotation_from_quaternion
from star_core.world.camera import Camera

MAX_RAY: Final = 10.0  # tangent of the angle off the axis, 84 degrees, up to which it is examined
MIN_SLOPE: Final = 0.25  # of the distorted radius over the ray's: with less the model folds back
MIN_CONVERGENCE: Final = 0.1  # by which OpenCV's fixed point shrinks an error in one iteration
ITERATIONS: Final = 200  # of that, at most
TOLERANCE: Final = 1e-7  # px between a pixel and the projection of its undistorted point

Number = TypeVar("Number", float, Array)


@dataclass(frozen=True)
class CameraModel:
    """The projection of a camera.

    A *ray* is the direction x / z, y / z in the camera's frame (x right, y down, z ahead): where
    the image would show a point with a focal length of 1 and no distortion. The middle of the first
    pixel is at (0, 0).

    A polynomial that was fitted to the middle of the image can fold back before its corners. The
    model is used up to the ray of length `reach`, where its slope falls to `MIN_SLOPE`, or where
    OpenCV's inverse no longer converges; no ray belongs to pixels beyond.

    Attributes:
        camera: Intrinsics and mounting.
    """

    camera: Camera

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Height and width of the image, px."""
        return self.camera.height, self.camera.width

    @cached_property
    def matrix(self) -> Array:
        """(3, 3) intrinsics, px."""
        fx, fy, cx, cy = self.camera.matrix
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @cached_property
    def mounting(self) -> Pose:
        """The camera's frame in the body frame."""
        camera = self.camera
        return Pose(rotation_from_quaternion(camera.rotation), np.array(camera.position))

    @cached_property
    def reach(self) -> float:
        """Greatest length of a ray at which the model is used; infinite if it never folds back."""
        k1, k2, _, _, k3 = self.camera.distortion
        radius = np.linspace(0.0, MAX_RAY, 10_000)
        radial = 1 + k1 * radius**2 + k2 * radius**4 + k3 * radius**6
        slope = 1 + 3 * k1 * radius**2 + 5 * k2 * radius**4 + 7 * k3 * radius**6
        with np.errstate(divide="ignore", invalid="ignore"):
            converges = np.abs(1 - slope / radial) <= 1 - MIN_CONVERGENCE
        return float(radius[~(converges & (slope >= MIN_SLOPE))].min(initial=math.inf))

    @cached_property
    def rays(self) -> NDArray[np.float32]:
        """(height, width, 2) rays of the image's pixels, NaN beyond `reach`."""
        v, u = np.indices(self.shape)
        return self.undistort(np.stack([u, v], axis=-1)).astype(np.float32)

    def project(self, points: Array) -> Array:
        """Return the (..., 2) pixels of (..., 3) points in the camera's frame, in front of it."""
        ray = points[..., :2] / points[..., 2:]
        fx, fy, cx, cy = self.camera.matrix
        x, y = distort(ray[..., 0], ray[..., 1], *self.camera.distortion)
        pixels: Array = np.stack([fx * x + cx, fy * y + cy], axis=-1)
        return pixels

    def sees(self, points: Array, border: float | Array = 0.0) -> Mask:
        """Return whether points lie in the image: (...,).

        Args:
            points: (..., 3) in the camera's frame, m, in front of it.
            border: Number, or (...,), by which they must be inside the outermost pixels, px.
        """
        pixels = self.project(points)
        u, v = pixels[..., 0], pixels[..., 1]
        within = (u >= border) & (u <= self.camera.width - 1 - border)
        visible: Mask = within & (v >= border) & (v <= self.camera.height - 1 - border)
        return visible & self.in_reach(points)

    def in_reach(self, points: Array) -> Mask:
        """Return whether the model has pixels for (..., 3) points in the camera's frame: (...,)."""
        z = points[..., 2]
        visible: Mask = (z > 0) & (np.hypot(points[..., 0], points[..., 1]) <= self.reach * z)
        return visible

    def undistort(self, pixels: Array, *, clip: bool = False) -> Array:
        """Return the (..., 2) rays of (..., 2) pixels, by OpenCV.

        Args:
            pixels: px, inside the image or not.
            clip: Whether pixels beyond `reach` have the ray of the last ones within instead of NaN.
        """
        import cv2

        fx, fy, cx, cy = self.camera.matrix
        flat = np.asarray(pixels, np.float64).reshape(-1, 1, 2)
        if not len(flat):
            return np.zeros(pixels.shape)
        distorted = (flat - (cx, cy)) / (fx, fy)
        radius = np.hypot(distorted[..., :1], distorted[..., 1:])
        beyond = radius > self._distorted_reach
        if clip:
            ones = np.ones_like(radius)
            distorted *= np.divide(self._distorted_reach, radius, out=ones, where=beyond)
            flat = distorted * (fx, fy) + (cx, cy)
        distortion = np.array(self.camera.distortion)
        undistorted = _float(cv2.undistortPoints(flat, self.matrix, distortion, criteria=_CRITERIA))
        length = np.hypot(
            undistorted[..., :1], undistorted[..., 1:]
        )  # tangential distortion moves the edge
        beyond |= length > self.reach
        if clip:
            undistorted /= np.maximum(length / self.reach, 1.0)
        else:
            undistorted[beyond[..., 0]] = np.nan
        return undistorted.reshape(pixels.shape)

    def magnification(self, rays: Array) -> Array:
        """Return the number of pixels per unit of a ray at (..., 2) rays: (...,).

        It is the geometric mean over the directions, with the radial distortion only: towards the
        corners of a wide image a pixel covers more.
        """
        k1, k2, _, _, k3 = self.camera.distortion
        r2 = (rays * rays).sum(axis=-1)
        around = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        along = 1 + r2 * (3 * k1 + r2 * (5 * k2 + r2 * 7 * k3))
        focal = self.camera.matrix[0] * self.camera.matrix[1]
        scale: Array = np.sqrt(focal * np.maximum(around * along, 0.01))
        return scale

    def row_delay(self, pixels: Array) -> Array:
        """Return the delay of the rows of (..., 2) pixels after the middle row, s: (...,)."""
        rows = self.camera.height - 1
        delay: Array = (pixels[..., 1] / rows - 0.5) * self.camera.readout
        return delay

    @cached_property
    def _distorted_reach(self) -> float:
        """Length of the ray of length `reach` after distortion."""
        if math.isinf(self.reach):
            return math.inf
        k1, k2, _, _, k3 = self.camera.distortion
        return distort(self.reach, 0.0, k1, k2, 0.0, 0.0, k3)[0]


def distort(
    x: Number, y: Number, k1: float, k2: float, p1: float, p2: float, k3: float
) -> tuple[Number, Number]:
    """Return a distorted ray, by OpenCV's radial and tangential distortion.

    The model is that of Brown, "Decentering distortion of lenses" (Photogrammetric Engineering 32,
    1966). It is plain arithmetic: numba compiles it, and it takes numbers as well as arrays.

    >>> distort(0.5, 0.0, -0.1, 0.0, 0.0, 0.0, 0.0)
    (0.4875, 0.0)
    """
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    across = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    down = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return across, down


_CRITERIA = (3, ITERATIONS, TOLERANCE)  # cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS


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


UPRIGHT_PENALTY: Final = 6.0
"""Squared deviations by which corners must favor a square on a wall over one on the floor. Where a
camera looks down at 45°, one may look like the other."""


def upright_misfit(pose: Pose, misfit: float, up: Array) -> float:
    """Return the misfit of one of the poses of a square, less a preference for level squares.

    Args:
        pose: Of the square in the camera's frame.
        misfit: Sum of the squared residuals of its corners, in standard deviations.
        up: (3,) unit vector against gravity in the camera's frame.
    """
    return misfit - UPRIGHT_PENALTY * float(pose.rotation[:, 2] @ up)


def _float(values: object) -> Array:
    return np.asarray(values, np.float64)
