"""True tags and cameras, which differ from those of a mission by errors of survey and mounting."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from star_core import Camera, Tag
from star_sim.camera_sim.options import CameraOptions


def real_tags(tags: Sequence[Tag], seed: Sequence[int], error: CameraOptions) -> tuple[Tag, ...]:
    """Return the true tags.

    The tags of one landmark or target are on one sheet and move together. A sheet is shifted, and
    rotated about its center.

    Args:
        tags: As surveyed.
        seed: Of two random streams; numbers are drawn for each sheet, in the order in which sheets
            first appear.
        error: Has the standard deviations of sheets.
    """
    turn, tilt = math.radians(error.survey_yaw_std_deg), math.radians(error.survey_tilt_std_deg)
    in_plane, out_of_plane = np.random.default_rng(seed), np.random.default_rng([*seed, 1])
    sheets: dict[str, list[Tag]] = {}
    for tag in tags:
        sheets.setdefault(tag.of, []).append(tag)
    moves = {}
    for name, members in sheets.items():
        right, up, angle = in_plane.standard_normal(3) * [error.survey_std, error.survey_std, turn]
        tilts = out_of_plane.standard_normal(3) * [tilt, tilt, error.survey_height_std]
        surface = Rotation.from_quat(members[0].rotation)
        center = np.mean([tag.position for tag in members], axis=0)
        rotation = Rotation.from_rotvec(surface.apply([*tilts[:2], angle]))
        moves[name] = (center, rotation, surface.apply([right, up, tilts[2]]))
    return tuple(_moved(tag, *moves[tag.of]) for tag in tags)


def real_camera(camera: Camera, rng: np.random.Generator, error: CameraOptions) -> Camera:
    """Return the true camera.

    Args:
        camera: As calibrated.
        rng: Nine numbers are drawn.
        error: Has the standard deviations of mounting and calibration.
    """
    mounting = [[error.mounting_position_std], [math.radians(error.mounting_std_deg)]]
    shift, angles = rng.standard_normal((2, 3)) * mounting
    center_std = error.image_center_std
    stretch, *center = rng.standard_normal(3) * [error.focal_length_std, center_std, center_std]
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
