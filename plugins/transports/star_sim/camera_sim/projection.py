"""From points of the map to pixels, from pixels to planes, and the image region of a flat shape."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array
from star_core.toolkit import compiled, subroutine
from star_sim.camera_sim.camera_pose import POSE, Exposure, Optics, camera_at, pixel, row_time
from star_sim.drone import Record

NEAR = 1e-3  # m, distance to the camera's plane below which nothing is seen
CONVERGED = 1e-9  # px
MAX_ITERATIONS = 20
PIECES = 4  # of an edge whose ends are projected: the lens bends edges
MARGIN = 2  # px, around a region: for the spread of light, and for motion in between


@compiled
def project(points: Array, shot: Array, mount: Array, lens: Optics) -> Array:
    """Return the pixels at which points of the map are seen.

    A point is seen at the row that is exposed when the point is there: with a moving camera, row
    and time are found together, by iteration.

    Args:
        points: (P, 3) m.
        shot: (13,) of `Shot.packed`.
        mount: (12,) of `mounting`.
        lens: Of `optics`.

    Returns:
        (P, 2) u and v, px, inside the image or not; NaN behind the camera or beyond its reach.
    """
    projected = np.empty((len(points), 2))
    pose = np.empty(POSE)
    for k in range(len(points)):
        v = 0.5 * (lens.height - 1.0)
        u = before = math.nan
        for _ in range(MAX_ITERATIONS):
            camera_at(shot, mount, row_time(lens, v), pose)
            a, b, c = points[k, 0] - pose[9], points[k, 1] - pose[10], points[k, 2] - pose[11]
            x = pose[0] * a + pose[3] * b + pose[6] * c
            y = pose[1] * a + pose[4] * b + pose[7] * c
            z = pose[2] * a + pose[5] * b + pose[8] * c
            if z < NEAR or math.hypot(x, y) > lens.reach * z:
                u = v = math.nan
                break
            before = v
            u, v = pixel(lens, x / z, y / z)
            if abs(v - before) < CONVERGED:
                break
        projected[k, 0], projected[k, 1] = u, v
    return projected


@subroutine
def touch(corners: Record, exposure: Exposure, region: Record) -> None:  # noqa: C901 -- one function compiles faster
    """Extend a region of the image by the pixels of a flat quadrangle.

    The quadrangle is clipped to the camera's field (Sutherland and Hodgman, Communications of the
    ACM 17(1), 1974) and projected, from the first and the last pose of the exposure.

    Args:
        corners: (4, 3) in the map, m.
        exposure: The image.
        region: (4,) first column and row and the ones past the last, extended in place.
    """
    poses, lens = exposure.poses, exposure.lens
    left, top, right, bottom = exposure.field
    kept, cut = np.empty((10, 3)), np.empty((10, 3))
    for end in range(2):
        pose = poses[-end, -end]
        count = 4
        for k in range(4):
            x, y, z = corners[k, 0] - pose[9], corners[k, 1] - pose[10], corners[k, 2] - pose[11]
            for axis in range(3):
                kept[k, axis] = pose[axis] * x + pose[3 + axis] * y + pose[6 + axis] * z
        for a, b, c, d in (
            (0.0, 0.0, 1.0, -NEAR),
            (1.0, 0.0, -left, 0.0),
            (-1.0, 0.0, right, 0.0),
            (0.0, 1.0, -top, 0.0),
            (0.0, -1.0, bottom, 0.0),
        ):
            clipped = 0
            for k in range(count):
                after = (k + 1) % count
                distance = a * kept[k, 0] + b * kept[k, 1] + c * kept[k, 2] + d
                next_distance = a * kept[after, 0] + b * kept[after, 1] + c * kept[after, 2] + d
                if distance >= 0.0:
                    for axis in range(3):
                        cut[clipped, axis] = kept[k, axis]
                    clipped += 1
                if (distance >= 0.0) != (next_distance >= 0.0):
                    share = distance / (distance - next_distance)
                    for axis in range(3):
                        step = kept[after, axis] - kept[k, axis]
                        cut[clipped, axis] = kept[k, axis] + share * step
                    clipped += 1
            count = clipped
            kept, cut = cut, kept
        for k in range(count):
            after = (k + 1) % count
            x, y = kept[k, 0] / kept[k, 2], kept[k, 1] / kept[k, 2]
            across, down = kept[after, 0] / kept[after, 2] - x, kept[after, 1] / kept[after, 2] - y
            for piece in range(PIECES):  # of equal lengths in the image, but for the distortion
                share = piece / PIECES
                u, v = pixel(lens, x + share * across, y + share * down)
                region[0] = min(region[0], max(0, math.floor(u) - MARGIN))
                region[1] = min(region[1], max(0, math.floor(v) - MARGIN))
                region[2] = max(region[2], min(int(lens.width), math.ceil(u) + MARGIN + 1))
                region[3] = max(region[3], min(int(lens.height), math.ceil(v) + MARGIN + 1))


@subroutine
def plane_homography(
    pose: Record, frame: Record, unit: float, middle: float, map_: Record
) -> float:
    """Compute the homography from directions of a camera to a plane.

    A ray ``c + depth * R (x, y, 1)`` meets the plane at ``depth = away / w``; there ``s / w``
    grows along the plane's x axis and ``t / w`` against its y axis, where s, t and w are the
    products of (x, y, 1) with the three rows of the homography.

    Args:
        pose: (12,) of the camera.
        frame: (>= 12,) origin, x, y and z axes of the plane in the map, m.
        unit: Length of one step of s and t, m.
        middle: s and t of the origin.
        map_: (9,) overwritten with the homography.

    Returns:
        The plane's distance before the camera along its own z axis, m: negative in front of it.
    """
    x, y, z = pose[9] - frame[0], pose[10] - frame[1], pose[11] - frame[2]
    along = (x * frame[3] + y * frame[4] + z * frame[5]) / unit
    up = -(x * frame[6] + y * frame[7] + z * frame[8]) / unit
    away = -(x * frame[9] + y * frame[10] + z * frame[11])
    for axis in range(3):
        a, b, c = pose[axis], pose[3 + axis], pose[6 + axis]
        normal = a * frame[9] + b * frame[10] + c * frame[11]
        right = (a * frame[3] + b * frame[4] + c * frame[5]) / unit
        over = -(a * frame[6] + b * frame[7] + c * frame[8]) / unit
        map_[axis] = (along + middle) * normal + away * right
        map_[3 + axis] = (up + middle) * normal + away * over
        map_[6 + axis] = normal
    return float(away)
