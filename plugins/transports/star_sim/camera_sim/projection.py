"""Where points of the map come to lie in an image, and which part of it a flat thing can touch."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array
from star_sim.camera_sim.motion import POSE, camera_at, row_time
from star_sim.camera_sim.optics import Optics, pixel
from star_sim.compiled import Record, compiled, kernel

NEAR = 1e-3  # m, what is nearer to the camera's plane is not seen
CONVERGED = 1e-9  # px
PIECES = 4  # of an edge, of which the ends are projected: the lens bends edges
MARGIN = 2  # px, around what was found: for the spread of light, and for what moves in between


@kernel
def project(points: Array, shot: Array, mount: Array, lens: Optics) -> Array:
    """Return the pixels at which points of the map are seen.

    A point is seen at the row that is exposed when the point is there: with a camera that moves,
    row and time are found together, by iteration.

    Args:
        points: (P, 3) m.
        shot: (13,) of `Shot.packed`.
        mount: (12,) of `mounting`.
        lens: Of `optics`.

    Returns:
        (P, 2) u and v, px; NaN for what is behind the camera or far outside the lens's field. The
        image's edges are not looked at.
    """
    seen = np.empty((len(points), 2))
    pose = np.empty(POSE)
    for k in range(len(points)):
        v = 0.5 * (lens.height - 1.0)
        u = before = math.nan
        for _ in range(20):
            camera_at(shot, mount, row_time(lens, v), pose)
            x, y, z = inside(pose, points[k, 0], points[k, 1], points[k, 2])
            if z < NEAR or math.hypot(x, y) > lens.reach * z:
                u = v = math.nan
                break
            before = v
            u, v = pixel(lens, x / z, y / z)
            if abs(v - before) < CONVERGED:
                break
        seen[k, 0], seen[k, 1] = u, v
    return seen


@compiled
def inside(pose: Record, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a point of the map in the frame of a camera with some pose, m."""
    x, y, z = x - pose[9], y - pose[10], z - pose[11]
    return (
        pose[0] * x + pose[3] * y + pose[6] * z,
        pose[1] * x + pose[4] * y + pose[7] * z,
        pose[2] * x + pose[5] * y + pose[8] * z,
    )


@compiled
def touch(
    corners: Record,
    pose: Record,
    lens: Optics,
    view: tuple[float, float, float, float],
    region: Record,
) -> None:
    """Widen a region of the image by all that a flat quadrangle can touch.

    The quadrangle is cut to the camera's field (Sutherland and Hodgman's algorithm, Communications
    of the ACM 17(1), 1974), and what is left is projected.

    Args:
        corners: (4, 3) in the map, m.
        pose: (12,) of the camera.
        lens: The camera.
        view: Least x and y, greatest x and y of the directions in the field.
        region: (4,) first column and row and the ones past the last, widened in place.
    """
    left, top, right, bottom = view
    kept, cut = np.empty((10, 3)), np.empty((10, 3))
    count = 4
    for k in range(4):
        x, y, z = inside(pose, corners[k, 0], corners[k, 1], corners[k, 2])
        kept[k, 0], kept[k, 1], kept[k, 2] = x, y, z
    for a, b, c, d in (
        (0.0, 0.0, 1.0, -NEAR),
        (1.0, 0.0, -left, 0.0),
        (-1.0, 0.0, right, 0.0),
        (0.0, 1.0, -top, 0.0),
        (0.0, -1.0, bottom, 0.0),
    ):
        left_over = 0
        for k in range(count):
            x, y, z = kept[k, 0], kept[k, 1], kept[k, 2]
            after = (k + 1) % count
            here = a * x + b * y + c * z + d
            there = a * kept[after, 0] + b * kept[after, 1] + c * kept[after, 2] + d
            if here >= 0.0:
                cut[left_over, 0], cut[left_over, 1], cut[left_over, 2] = x, y, z
                left_over += 1
            if (here >= 0.0) != (there >= 0.0):
                share = here / (here - there)
                cut[left_over, 0] = x + share * (kept[after, 0] - x)
                cut[left_over, 1] = y + share * (kept[after, 1] - y)
                cut[left_over, 2] = z + share * (kept[after, 2] - z)
                left_over += 1
        count = left_over
        kept, cut = cut, kept
    for k in range(count):
        after = (k + 1) % count
        for piece in range(PIECES):
            share = piece / PIECES
            x = kept[k, 0] + share * (kept[after, 0] - kept[k, 0])
            y = kept[k, 1] + share * (kept[after, 1] - kept[k, 1])
            z = kept[k, 2] + share * (kept[after, 2] - kept[k, 2])
            u, v = pixel(lens, x / z, y / z)
            region[0] = min(region[0], max(0, math.floor(u) - MARGIN))
            region[1] = min(region[1], max(0, math.floor(v) - MARGIN))
            region[2] = max(region[2], min(int(lens.width), math.ceil(u) + MARGIN + 1))
            region[3] = max(region[3], min(int(lens.height), math.ceil(v) + MARGIN + 1))
