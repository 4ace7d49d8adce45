"""Standard deviations to expect along paths: small where tags are seen, growing in between."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from star_apriltag.dead_reckoning import (
    ARM_STD,
    DRIFT_STD,
    FLOOR_LENGTH,
    FLOOR_STD,
    LEAST_HEIGHT,
    POSITION_PER_TIME,
    SCALE_STD,
    SLIP_RATE,
    SLIP_TIME,
    START_STD,
    START_YAW_STD,
    TURN_STD,
    rotation_about_z,
)
from star_core import Array, Camera, Mask, Obstacle, Scene, Tag
from star_core.toolkit import CameraModel, rotation_from_quaternion, square_corners

SEEN_STD: Final = 0.03  # m, while a tag is in view
GROUND: Final = 0.05  # m, up to which an agent stands, where its position does not drift
SURE_STD: Final = 0.2  # m, up to which an agent sees the tags that are seen from its path
BESIDE: Final = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)], np.float64)
"""Directions from a path, in which an uncertain agent may be by one deviation."""
MIN_EDGE: Final = 13.0  # px, longest side of a tag that is still found in an image
MIN_WIDTH: Final = 13.2  # px across the longest side: eight modules, for detectors without priors
BORDER: Final = 8.0
"""Border of the image in which no tag counts as seen, px: 3 in which no corner is detected, and 5,
or 1.6°, by which a drone that hovers tilts and turns. Two random missions whose tags were at 4 to
9 px from the edge drifted for 3 to 6 s without them, into an obstacle and into another drone."""
POINTS: Final = 24  # of a line of sight, compared with obstacles

PER_TIME: Final = POSITION_PER_TIME**2  # m²/s
PER_HEIGHT: Final = 2 * SLIP_RATE**2 * SLIP_TIME  # m²/s, and per height, squared
PER_LENGTH: Final = 2 * FLOOR_STD**2 * FLOOR_LENGTH  # m²/m
PER_AREA: Final = SCALE_STD**2 + TURN_STD**2  # of the displacement, squared


def expected_std(
    scene: Scene,
    time: Array,
    position: Array,
    yaw: Array,
    *,
    max_tags_per_landmark: int,
    **_options: object,
) -> Array:
    """Return the greatest standard deviation in the plane along paths: (T, N) m.

    While a level drone has a landmark's tag in its image, it is `SEEN_STD`; a drone that is less
    certain sees one again only if it does so also that far beside its path. Since then, the errors
    of dead reckoning grow: white noise with the time and with the height, errors of the velocity
    with the time, the floor's texture with the length of the path, and scale and heading, as
    uncertain as before they are calibrated in flight, with the displacement and, of a displacement
    that turns with the body, with the heading. Obstacles hide tags; floor odometry, which needs
    texture, does not help.

    Args:
        scene: Agents with their cameras, and landmarks.
        time: (T,) s.
        position: (T, N, 3) m.
        yaw: (T, N) rad.
        max_tags_per_landmark: The option; with 0 no tag is used.
    """
    tags = scene.world.landmarks if max_tags_per_landmark else ()
    std = np.empty(yaw.shape)
    for row, agent in enumerate(scene.agents):
        sees = partial(_sees, scene, agent.camera, tags)
        height = position[:, row, 2] - agent.start[2]
        std[:, row] = _along(time, position[:, row], height, yaw[:, row], sees)
    return std


def _along(
    time: Array, position: Array, height: Array, yaw: Array, sees: Callable[[Array, Array], Mask]
) -> Array:
    """Return the standard deviation along a path, by where tags are seen: (T,) m.

    Args:
        time: (T,) s.
        position: (T, 3) positions, m.
        height: (T,) above the floor, m.
        yaw: (T,) rad.
        sees: Returns at which of (K, 3) positions, with (K,) headings, a tag is detected: (K,).
    """
    visible, flat = sees(position, yaw), position[:, :2]
    step = np.hypot(*np.diff(flat, axis=0, prepend=flat[:1]).T)
    std = np.empty(len(time))
    base, since, area = START_STD**2, 0, PER_AREA + START_YAW_STD**2
    length = np.cumsum(step)
    took = np.where(height > GROUND, np.diff(time, prepend=time[0]), 0.0)  # s, in the air
    noise = np.cumsum((PER_TIME + PER_HEIGHT * np.maximum(height, LEAST_HEIGHT) ** 2) * took)
    flown = np.cumsum(took)
    poses = np.column_stack([position, yaw])
    moved = (np.diff(poses, axis=0, prepend=poses[:1]) != 0.0).any(axis=1)
    seen = np.zeros(len(BESIDE), np.bool_)  # beside the path, since the position became uncertain
    for k in range(len(time)):
        before = std[k - 1] if k else 0.0
        if before <= SURE_STD:
            seen[:] = visible[k]
        elif moved[k]:
            rows = np.flatnonzero(~seen)
            seen[rows] = sees(position[k] + before * BESIDE[rows], np.full(len(rows), yaw[k]))
        if seen.all():
            base, since, area = SEEN_STD**2, k, PER_AREA
            seen[:] = False
        away = float(((flat[k] - flat[since]) ** 2).sum())
        grown = noise[k] - noise[since] + PER_LENGTH * (length[k] - length[since])
        grown += (DRIFT_STD * (flown[k] - flown[since])) ** 2
        grown += ARM_STD**2 * 2 * (1 - np.cos(yaw[k] - yaw[since]))  # of a chord, squared
        std[k] = np.sqrt(base + grown + area * away)
    return std


def _sees(
    scene: Scene, camera: Camera | None, tags: tuple[Tag, ...], position: Array, yaw: Array
) -> Mask:
    """Return at which of (T, 3) positions, with (T,) headings, a tag is detected: (T,).

    In images, where tags are expected, they are found at slants at which a detector on board, which
    expects none, does not read them.
    """
    visible = np.zeros(len(position), np.bool_)
    if camera is None or not tags:
        return visible
    model = CameraModel(camera)
    mount = model.mounting
    times, eyes, ends = [], [], []  # of the lines of sight
    rotations = np.array([rotation_from_quaternion(tag.rotation) for tag in tags])
    centers = np.array([tag.position for tag in tags])
    corners = np.array([square_corners(tag.size) for tag in tags])  # (K, 4, 3)
    corners = np.einsum("kij,kcj->kci", rotations, corners) + centers[:, None]
    for k, (origin, heading) in enumerate(zip(position, yaw.tolist(), strict=True)):
        body = rotation_about_z(heading)
        eye = origin + body @ mount.position
        facing = ((eye - centers) * rotations[:, :, 2]).sum(axis=1) > 0.0
        points = (corners[facing] - eye) @ (body @ mount.rotation)
        ahead = np.flatnonzero((points[..., 2] > 0.0).all(axis=1))
        whole = ahead[model.sees(points[ahead], BORDER).all(axis=1)]
        pixels = model.project(points[whole])
        longest, width = _sizes(pixels)
        readable = width >= MIN_WIDTH if scene.detects_tags else longest >= MIN_EDGE
        detected = centers[facing][whole[readable]]
        times += [k] * len(detected)
        eyes += [eye] * len(detected)
        ends += [*detected]
    if times:
        clear = _clear(scene.world.obstacles, np.array(eyes), np.array(ends))
        visible[np.array(times)[clear]] = True
    return visible


def _sizes(pixels: Array) -> tuple[Array, Array]:
    """Return the longest sides of (K, 4, 2) tags in the image and the widths across them: (K,) px.

    Of a tag that is seen at a slant the width is less than any side.
    """
    longest = np.linalg.norm(pixels - np.roll(pixels, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    a, b = pixels[:, 2] - pixels[:, 0], pixels[:, 3] - pixels[:, 1]  # diagonals
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    return longest, area / np.maximum(longest, 1.0)


def _clear(obstacles: tuple[Obstacle, ...], eyes: Array, ends: Array) -> Mask:
    """Return between which of (K, 3) points and (K, 3) others there is no obstacle: (K,)."""
    share = (np.arange(POINTS) + 0.5)[:, None, None] / POINTS
    points = eyes + share * (ends - eyes)  # (POINTS, K, 3)
    half = np.linalg.norm(ends - eyes, axis=1) / POINTS / 2  # m, of the way between two of them
    clear = np.ones(len(eyes), np.bool_)
    for obstacle in obstacles:
        distance = obstacle.distances(points.reshape(-1, 3)).reshape(POINTS, -1)
        clear &= (distance > half).all(axis=0)
    return clear
