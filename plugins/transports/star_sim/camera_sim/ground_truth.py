"""True tags and cameras, which differ from those of a mission by errors of survey and mounting."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from star_core import Camera, Tag


def real_tags(
    tags: Sequence[Tag], rng: np.random.Generator, *, position: float, turn: float
) -> tuple[Tag, ...]:
    """Return the true tags.

    The tags of one landmark or target are on one sheet and move together. A sheet is shifted on its
    surface and rotated about its center.

    Args:
        tags: As surveyed.
        rng: Three numbers are drawn for each sheet, in the order in which sheets first appear.
        position: Standard deviation of a sheet's position along each of its two axes, m.
        turn: Standard deviation of a sheet's heading on its surface, rad.
    """
    sheets: dict[str, list[Tag]] = {}
    for tag in tags:
        sheets.setdefault(tag.of, []).append(tag)
    moves = {}
    for name, members in sheets.items():
        right, up, angle = rng.standard_normal(3) * [position, position, turn]
        surface = Rotation.from_quat(members[0].rotation)
        center = np.mean([tag.position for tag in members], axis=0)
        rotation = Rotation.from_rotvec(surface.apply([0.0, 0.0, angle]))
        moves[name] = (center, rotation, surface.apply([right, up, 0.0]))
    return tuple(_moved(tag, *moves[tag.of]) for tag in tags)


def real_camera(
    camera: Camera, rng: np.random.Generator, *, position: float, turn: float
) -> Camera:
    """Return the true camera.

    Args:
        camera: As calibrated.
        rng: Six numbers are drawn.
        position: Standard deviation of its position along each axis of the body, m.
        turn: Standard deviation of its attitude about each of its own axes, rad.
    """
    shift, angles = rng.standard_normal((2, 3)) * [[position], [turn]]
    body_from_level = Rotation.from_euler("xyz", [camera.roll, camera.pitch, camera.yaw])
    roll, pitch, yaw = (body_from_level * Rotation.from_rotvec(angles)).as_euler("xyz").tolist()
    x, y, z = np.add(camera.position, shift).tolist()
    return dataclasses.replace(camera, position=(x, y, z), roll=roll, pitch=pitch, yaw=yaw)


def _moved(tag: Tag, center: np.ndarray, rotation: Rotation, shift: np.ndarray) -> Tag:
    """Return a tag that was rotated about a point and then shifted."""
    x, y, z = (center + rotation.apply(np.subtract(tag.position, center)) + shift).tolist()
    attitude = (rotation * Rotation.from_quat(tag.rotation)).as_quat().tolist()
    return dataclasses.replace(tag, position=(x, y, z), rotation=tuple(attitude))
