"""The lens of a camera, and its poses while rows are exposed one after the other.

A pose is 12 numbers: the rotation from the camera's frame to the map, row by row, and the camera's
position in the map, m.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from star_core import Array, Camera
from star_core.toolkit import CameraModel, compiled, distort, subroutine
from star_sim.drone import Record

POSE = 12


class Shot(NamedTuple):
    """The body half-way through the exposure of the middle row, and its motion."""

    position: Array  # (3,) of the body's frame in the map, m
    attitude: Array  # (4,) unit quaternion x, y, z, w from the body to the map
    velocity: Array  # (3,) in the map, m/s; taken as constant during the image
    rates: Array  # (3,) angular velocity in the body, rad/s; likewise

    def packed(self) -> Array:
        """Return (13,) all of it in a row, for kernels."""
        return np.concatenate(self)


class Exposure(NamedTuple):
    """One image, for the kernels that draw into it."""

    rays: Array  # (2, H, W) directions of pixels
    poses: Array  # (H, S, 12) of the camera, in S slices of each row's exposure
    lens: Optics  # the camera
    field: tuple[float, float, float, float]  # least x and y, greatest x and y of the directions


class Canvas(NamedTuple):
    """Layers of an image, each (H, W); the kernels draw into them from front to back."""

    light: Array  # gray values
    gap: Array  # share of each pixel that is not covered yet, so that adjacent shapes leave no seam
    depth: Array  # of the nearest obstacle along each ray, m
    shade: Array  # gray values of obstacles


def mounting(camera: Camera) -> Array:
    """Return the pose of a camera in the body, (12,)."""
    pose = CameraModel(camera).mounting
    return np.concatenate([pose.rotation.ravel(), pose.position])


@subroutine
def row_time(lens: Optics, v: float) -> float:
    """Return the middle of the exposure of row `v`, s after that of the middle row."""
    return float(lens.readout * (v / (lens.height - 1.0) - 0.5))


@compiled
def poses(shot: Array, mount: Array, lens: Optics, slices: int) -> Array:
    """Return the camera's poses, (height, slices, 12), in equal slices of each row's exposure."""
    table = np.empty((int(lens.height), slices, POSE))
    for v in range(table.shape[0]):
        for k in range(slices):
            late = lens.exposure * ((k + 0.5) / slices - 0.5)
            camera_at(shot, mount, row_time(lens, v) + late, table[v, k])
    return table


@subroutine
def camera_at(shot: Record, mount: Record, time: float, pose: Record) -> None:
    """Compute the camera's pose some time after the middle of a shot.

    The body moves straight and turns about a fixed axis: ``R exp(rates * time)``, by Rodrigues'
    formula.

    Args:
        shot: (13,) of `Shot.packed`.
        mount: (12,) pose of the camera in the body.
        time: s.
        pose: (12,) overwritten with the camera's pose in the map.
    """
    qx, qy, qz, qw = shot[3], shot[4], shot[5], shot[6]
    wx, wy, wz = shot[10] * time, shot[11] * time, shot[12] * time
    half = 0.5 * math.sqrt(wx * wx + wy * wy + wz * wz)
    sine = 0.5 * (math.sin(half) / half if half > 0.0 else 1.0)
    ax, ay, az, aw = sine * wx, sine * wy, sine * wz, math.cos(half)
    x = qw * ax + qx * aw + qy * az - qz * ay
    y = qw * ay - qx * az + qy * aw + qz * ax
    z = qw * az + qx * ay - qy * ax + qz * aw
    w = qw * aw - qx * ax - qy * ay - qz * az
    for column in range(4):
        if column < 3:  # noqa: PLR2004 -- the columns of the rotation, then the position
            a, b, c = mount[column], mount[3 + column], mount[6 + column]
        else:
            a, b, c = mount[9], mount[10], mount[11]
        p, q, r = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
        a, b, c = a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p
        if column < 3:  # noqa: PLR2004
            pose[column], pose[3 + column], pose[6 + column] = a, b, c
        else:
            pose[9] = a + shot[0] + shot[7] * time
            pose[10] = b + shot[1] + shot[8] * time
            pose[11] = c + shot[2] + shot[9] * time


FIELD_MARGIN = 1.1  # of the farthest pixel's direction, up to which directions are projected


class Optics(NamedTuple):
    """A camera's numbers for kernels, all floats; see `Camera` for their units.

    `reach` is the greatest tangent of the angle off the axis at which the model is used.
    """

    width: float
    height: float
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    exposure: float
    readout: float
    reach: float


def optics(camera: Camera) -> Optics:
    """Return a camera's numbers for the kernels.

    A direction beyond the model's reach is not seen; pixels beyond it see what the last ones within
    it see.
    """
    farthest = float(np.hypot(*rays(camera)).max())
    reach = min(CameraModel(camera).reach, FIELD_MARGIN * farthest)
    size = camera.width, camera.height
    times = camera.exposure, camera.readout
    return Optics._make(map(float, (*size, *camera.matrix, *camera.distortion, *times, reach)))


def rays(camera: Camera) -> Array:
    """Return (2, height, width): x and y of the pixels' directions (x, y, 1), camera frame.

    Cameras with the same intrinsics share the array.
    """
    return _rays(camera.width, camera.height, tuple(camera.matrix), tuple(camera.distortion))


@lru_cache(maxsize=8)
def _rays(width: int, height: int, matrix: Any, distortion: Any) -> Array:
    camera = Camera(width=width, height=height, matrix=matrix, distortion=distortion)
    v, u = np.indices((height, width))
    table = CameraModel(camera).undistort(np.stack([u, v], axis=-1), clip=True)
    return np.ascontiguousarray(np.moveaxis(table, -1, 0))


@subroutine
def pixel(lens: Optics, x: float, y: float) -> tuple[float, float]:
    """Return the pixel u, v of the direction (x, y, 1) in the camera's frame."""
    across, down = _distort(x, y, lens.k1, lens.k2, lens.p1, lens.p2, lens.k3)
    return lens.fx * across + lens.cx, lens.fy * down + lens.cy


_distort = subroutine(distort)
