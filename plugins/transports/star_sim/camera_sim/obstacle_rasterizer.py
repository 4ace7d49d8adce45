"""Obstacles as a camera meets them: upright prisms that rays end at, plainly shaded."""

from __future__ import annotations

import math

import numpy as np

from star_sim.camera_sim.optics import Optics
from star_sim.camera_sim.projection import touch
from star_sim.compiled import Record, compiled, kernel

TOP, UNDER, SIDE, SHEEN = 150.0, 60.0, 95.0, 25.0  # grey values; sides differ by where they face
SUN = (0.8, 0.6)  # a unit vector: sides that face it are lighter


@kernel
def draw_prisms(  # noqa: PLR0913, PLR0917 -- a kernel takes all it needs
    depth: Record,
    shade: Record,
    rays: Record,
    poses: Record,
    lens: Optics,
    view: tuple[float, float, float, float],
    boxes: Record,
    spans: Record,
    edges: Record,
) -> None:
    """Find how far along each ray the first prism is, and its shade there, amid each exposure.

    Args:
        depth: (H, W) m; lessened.
        shade: (H, W) grey values; set where a prism is.
        rays: (2, H, W) directions of pixels.
        poses: (H, S, 12) of the camera.
        lens: The camera.
        view: The field of the camera, as `touch` takes it.
        boxes: (P, 6) of `star_sim.contact.prisms`, as `spans` and `edges` are.
        spans: (P, 2).
        edges: (E, 4).
    """
    height, slices = poses.shape[0], poses.shape[1]
    region = np.empty(4, np.int64)
    for prism in range(len(boxes)):
        region[0], region[1], region[2], region[3] = depth.shape[1], depth.shape[0], 0, 0
        for end in range(2):
            pose = poses[end * (height - 1), end * (slices - 1)]
            _touch_box(boxes[prism], pose, lens, view, region)
        around = edges[spans[prism, 0] : spans[prism, 1]]
        for v in range(region[1], region[3]):
            pose = poses[v, slices // 2]
            for u in range(region[0], region[2]):
                x, y = rays[0, v, u], rays[1, v, u]
                reach, grey = meet(
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
                    depth[v, u], shade[v, u] = reach, grey


@compiled
def blocked(
    eye: tuple[float, float, float],
    point: tuple[float, float, float],
    slack: float,
    boxes: Record,
    spans: Record,
    edges: Record,
) -> bool:
    """Whether a prism stands between an eye and a point of the map, `slack` metres before it."""
    way = (point[0] - eye[0], point[1] - eye[1], point[2] - eye[2])
    length = math.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
    for prism in range(len(boxes)):
        around = edges[spans[prism, 0] : spans[prism, 1]]
        if meet(eye, way, boxes[prism], around)[0] * length < length - slack:
            return True
    return False


@compiled
def meet(
    eye: tuple[float, float, float], way: tuple[float, float, float], box: Record, around: Record
) -> tuple[float, float]:
    """Return where on ``eye + reach * way`` a prism is first met, and the grey value of its face.

    Args:
        eye: In the map, m.
        way: In the map.
        box: (6,) bounds of the prism; the last two are its foot and its top, m.
        around: (E, 4) the edges of its polygon, x and y of one end and of the other, m.

    Returns:
        The reach, infinite if the prism is not met, and the grey value.
    """
    x, y, z = eye
    dx, dy, dz = way
    foot, top = box[4], box[5]
    nearest, grey = math.inf, 0.0
    lid = -1.0
    if dz < 0.0 and z > top:
        lid = (top - z) / dz
    elif dz > 0.0 and z < foot:
        lid = (foot - z) / dz
    within = False  # whether the ray goes through the polygon in the lid's plane
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
            grey = SIDE + SHEEN * (facing if across < 0.0 else -facing)
    if within and 0.0 < lid < nearest:
        nearest, grey = lid, TOP if dz < 0.0 else UNDER
    return nearest, grey


@compiled
def _touch_box(
    box: Record,
    pose: Record,
    lens: Optics,
    view: tuple[float, float, float, float],
    region: Record,
) -> None:
    """Widen a region of the image by all that a box can touch."""
    corners = np.empty((4, 3))
    for axis in range(3):
        for side in range(2):
            low = (box[0], box[1], box[4])
            high = (box[2], box[3], box[5])
            for k in range(4):
                one, two = (k == 1) | (k == 2), k >= 2  # noqa: PLR2004 -- round the face
                far = (side == 1, one, two)
                for offset in range(3):
                    where = (axis + offset) % 3
                    corners[k, where] = high[where] if far[offset] else low[where]
            touch(corners, pose, lens, view, region)
