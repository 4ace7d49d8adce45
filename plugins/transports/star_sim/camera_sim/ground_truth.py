"""True tags and cameras, which differ from those of a mission by errors of survey and mounting."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from star_core import Camera, Tag


class SurveyError(NamedTuple):
    """Standard deviations of a sheet's pose."""

    position: float  # m, along each of its two axes
    turn: float  # rad, of its rotation on its surface
    height: float = 0.0  # m, across its surface
    tilt: float = 0.0  # rad, about each of its two axes


def real_tags(tags: Sequence[Tag], seed: Sequence[int], error: SurveyError) -> tuple[Tag, ...]:
    """Return the true tags.

    The tags of one landmark or target are on one sheet and move together. A sheet is shifted, and
    rotated about its center.

    Args:
        tags: As surveyed.
        seed: Of two random streams; numbers are drawn for each sheet, in the order in which sheets
            first appear.
        error: Standard deviations.
    """
    in_plane, out_of_plane = np.random.default_rng(seed), np.random.default_rng([*seed, 1])
    sheets: dict[str, list[Tag]] = {}
    for tag in tags:
        sheets.setdefault(tag.of, []).append(tag)
    moves = {}
    for name, members in sheets.items():
        right, up, angle = in_plane.standard_normal(3) * [
            error.position,
            error.position,
            error.turn,
        ]
        tilts = out_of_plane.standard_normal(3) * [error.tilt, error.tilt, error.height]
        surface = Rotation.from_quat(members[0].rotation)
        center = np.mean([tag.position for tag in members], axis=0)
        rotation = Rotation.from_rotvec(surface.apply([*tilts[:2], angle]))
        moves[name] = (center, rotation, surface.apply([right, up, tilts[2]]))
    return tuple(_moved(tag, *moves[tag.of]) for tag in tags)


class CameraError(NamedTuple):
    """Standard deviations of a camera's mounting and calibration."""

    position: float  # m, along each axis of the body
    turn: float  # rad, about each of its own axes
    focal_length: float = 0.0  # fraction
    center: float = 0.0  # px, in u and in v


def real_camera(camera: Camera, rng: np.random.Generator, error: CameraError) -> Camera:
    """Return the true camera.

    Args:
        camera: As calibrated.
        rng: Nine numbers are drawn.
        error: Standard deviations.
    """
    shift, angles = rng.standard_normal((2, 3)) * [[error.position], [error.turn]]
    stretch, *center = rng.standard_normal(3) * [error.focal_length, error.center, error.center]
    fx, fy, cx, cy = camera.matrix
    matrix = ((1 + stretch) * fx, (1 + stretch) * fy, cx + center[0], cy + center[1])
    body_from_level = Rotation.from_euler("xyz", [camera.roll, camera.pitch, camera.yaw])
    roll, pitch, yaw = (body_from_level * Rotation.from_rotvec(angles)).as_euler("xyz").tolist()
    x, y, z = np.add(camera.position, shift).tolist()
    return dataclasses.replace(
        camera, position=(x, y, z), roll=roll, pitch=pitch, yaw=yaw, matrix=matrix
    )


def _moved(tag: Tag, center: np.ndarray, rotation: Rotation, shift: np.ndarray) -> Tag:
    """Return a tag that was rotated about a point and then shifted."""
    x, y, z = (center + rotation.apply(np.subtract(tag.position, center)) + shift).tolist()
    attitude = (rotation * Rotation.from_quat(tag.rotation)).as_quat().tolist()
    return dataclasses.replace(tag, position=(x, y, z), rotation=tuple(attitude))
