"""Draws obstacles: upright prisms with plainly shaded faces."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from star_core import Array
from star_core.toolkit import compiled, subroutine
from star_sim.camera_sim.camera_pose import Canvas, Exposure
from star_sim.camera_sim.projection import touch
from star_sim.drone import Record

Point: TypeAlias = tuple[float, float, float]  # in the map, m
Prisms: TypeAlias = tuple[Record, Record, Record]  # of `star_sim.contact.prisms`

TOP, UNDER, SIDE, SHEEN = 150.0, 60.0, 95.0, 25.0  # gray values; sides vary by SHEEN
SUN = (0.8, 0.6)  # unit vector towards which sides are lighter


def faces(boxes: Array) -> Array:
    """Return the corners of the faces of (P, 6) boxes in the map, (P, 6, 4, 3) m."""
    low, high = boxes[:, None, None, [0, 1, 4]], boxes[:, None, None, [2, 3, 5]]
    square = ((0, 0), (1, 0), (1, 1), (0, 1))
    units = [np.roll([side, *uv], axis) for axis in range(3) for side in (0, 1) for uv in square]
    return np.where(np.reshape(units, (6, 4, 3)), high, low)


@compiled
def draw_prisms(canvas: Canvas, exposure: Exposure, faces: Record, prisms: Prisms) -> None:
    """Draw the depth and shade of the nearest prism along each ray, amid the exposure.

    Args:
        canvas: Depth and shade are overwritten where a prism is nearest.
        exposure: The image.
        faces: (P, 6, 4, 3) of `faces`.
        prisms: Of `star_sim.contact.prisms`.
    """
    boxes, spans, edges = prisms
    depth, shade, rays, poses = canvas.depth, canvas.shade, exposure.rays, exposure.poses
    middle = poses.shape[1] // 2
    region = np.empty(4, np.int64)
    for prism in range(len(boxes)):
        region[0], region[1], region[2], region[3] = depth.shape[1], depth.shape[0], 0, 0
        for face in range(6):
            touch(faces[prism, face], exposure, region)
        around = edges[spans[prism, 0] : spans[prism, 1]]
        for v in range(region[1], region[3]):
            pose = poses[v, middle]
            for u in range(region[0], region[2]):
                x, y = rays[0, v, u], rays[1, v, u]
                reach, gray = intersect(
                    (pose[9], pose[10], pose[11]),
                    (
                        pose[0] * x + pose[1] * y + pose[2],
                        pose[3] * x + pose[4] * y + pose[5],
                        pose[6] * x + pose[7] * y + pose[8],
                    ),
                    boxes[prism],
                    around,
                )
                if reach < depth[v, u]:
                    depth[v, u], shade[v, u] = reach, gray


@subroutine
def blocked(eye: Point, point: Point, slack: float, prisms: Prisms) -> bool:
    """Return whether a prism hides a point of the map, `slack` m or more in front of it."""
    boxes, spans, edges = prisms
    way = (point[0] - eye[0], point[1] - eye[1], point[2] - eye[2])
    length = math.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
    for prism in range(len(boxes)):
        around = edges[spans[prism, 0] : spans[prism, 1]]
        if intersect(eye, way, boxes[prism], around)[0] * length < length - slack:
            return True
    return False


@subroutine
def intersect(eye: Point, way: Point, box: Record, around: Record) -> tuple[float, float]:
    """Intersect the ray ``eye + reach * way`` with a prism.

    Args:
        eye: In the map, m.
        way: In the map.
        box: (6,) bounds of the prism; the last two are its lower and upper end, m.
        around: (E, 4) edges of its polygon: x and y of both ends, m.

    Returns:
        The reach, infinite without an intersection, and the gray value of the face.
    """
    x, y, z = eye
    dx, dy, dz = way
    foot, top = box[4], box[5]
    nearest, gray = math.inf, 0.0
    lid = -1.0
    if dz < 0.0 and z > top:
        lid = (top - z) / dz
    elif dz > 0.0 and z < foot:
        lid = (foot - z) / dz
    within = False  # whether the ray passes through the polygon in the lid's plane
    px, py = x + lid * dx, y + lid * dy
    for k in range(len(around)):
        ax, ay, bx, by = around[k, 0], around[k, 1], around[k, 2], around[k, 3]
        ex, ey = bx - ax, by - ay
        if (ay > py) != (by > py) and px < ax + (py - ay) / ey * ex:
            within = not within
        across = dx * ey - dy * ex
        if across == 0.0:
            continue
        reach = ((ax - x) * ey - (ay - y) * ex) / across
        along = ((ax - x) * dy - (ay - y) * dx) / across
        if 0.0 < reach < nearest and 0.0 <= along <= 1.0 and foot <= z + reach * dz <= top:
            nearest = reach
            facing = (SUN[0] * ey - SUN[1] * ex) / math.hypot(ex, ey)
            gray = SIDE + SHEEN * (facing if across < 0.0 else -facing)
    if within and 0.0 < lid < nearest:
        nearest, gray = lid, TOP if dz < 0.0 else UNDER
    return nearest, gray
