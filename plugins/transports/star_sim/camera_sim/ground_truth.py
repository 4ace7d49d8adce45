"""The truth behind what is believed: where tags really lie and how a camera really sits.

A mission knows the tags that were surveyed and the camera that was calibrated. What the simulator
renders are tags and a camera that differ from them, once per flight.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from star_core import Camera, Tag


def real_tags(
    tags: Sequence[Tag], rng: np.random.Generator, *, position: float, turn: float
) -> tuple[Tag, ...]:
    """Return where tags really lie.

    The tags of one landmark or target are on one sheet: they move together. A sheet stays on the
    surface that it is on; it is shifted on it and turned about its middle.

    Args:
        tags: As surveyed.
        rng: Three numbers are drawn for each sheet, in the order in which sheets first appear.
        position: Deviation of a sheet's place along each of its two axes, m.
        turn: Deviation of a sheet's heading on its surface, rad.
    """
    sheets: dict[str, list[Tag]] = {}
    for tag in tags:
        sheets.setdefault(tag.of, []).append(tag)
    moves = {}
    for name, members in sheets.items():
        right, up, angle = rng.standard_normal(3) * [position, position, turn]
        surface = Rotation.from_quat(members[0].rotation)
        middle = np.mean([tag.position for tag in members], axis=0)
        turned = Rotation.from_rotvec(surface.apply([0.0, 0.0, angle]))
        moves[name] = (middle, turned, surface.apply([right, up, 0.0]))
    return tuple(_moved(tag, *moves[tag.of]) for tag in tags)


def real_camera(
    camera: Camera, rng: np.random.Generator, *, position: float, turn: float
) -> Camera:
    """Return how a camera really sits on its drone.

    Args:
        camera: As calibrated.
        rng: Six numbers are drawn.
        position: Deviation of its place along each axis of the body, m.
        turn: Deviation of its attitude about each of its own axes, rad.
    """
    shift, angles = rng.standard_normal((2, 3)) * [[position], [turn]]
    body_from_level = Rotation.from_euler("xyz", [camera.roll, camera.pitch, camera.yaw])
    error = Rotation.from_rotvec(angles)
    roll, pitch, yaw = (body_from_level * error).as_euler("xyz")
    x, y, z = np.add(camera.position, shift).tolist()
    return dataclasses.replace(
        camera, position=(x, y, z), roll=float(roll), pitch=float(pitch), yaw=float(yaw)
    )


def _moved(tag: Tag, middle: np.ndarray, turned: Rotation, shift: np.ndarray) -> Tag:
    """Return a tag that was turned about a point and then shifted."""
    x, y, z = (middle + turned.apply(np.subtract(tag.position, middle)) + shift).tolist()
    rotation = (turned * Rotation.from_quat(tag.rotation)).as_quat().tolist()
    return dataclasses.replace(tag, position=(x, y, z), rotation=tuple(rotation))
