"""Tags of the map that a camera shows from the start of its agent."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Agent, Pose, Scene
from star_core.toolkit import CameraModel, rotation_from_quaternion, square_corners

MIN_EDGE: Final = 20.0  # px, of a tag that any detector finds; chosen, not measured
MAX_ANGLE: Final = math.radians(60.0)  # between the view and the tag's normal, likewise


def tags_from(agent: Agent, scene: Scene) -> set[int]:
    """Return the numbers of the tags that are wholly visible, large, and seen from the front.

    Obstacles in between are not considered.
    """
    if agent.camera is None:
        return set()
    model = CameraModel(agent.camera)
    cos, sin = math.cos(agent.yaw), math.sin(agent.yaw)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    eye = Pose(turn, np.array(agent.start)) @ model.mounting
    visible = set()
    for tag in scene.world.landmarks:
        rotation = rotation_from_quaternion(tag.rotation)
        square = square_corners(tag.size) @ rotation.T + np.array(tag.position)
        corners = eye.inverse().apply(square)
        if (corners[:, 2] <= 0).any() or not model.sees(corners).all():
            continue
        pixels = model.project(corners)
        edge = np.linalg.norm(np.roll(pixels, 1, axis=0) - pixels, axis=1).min()
        view = np.array(eye.position) - np.array(tag.position)
        facing = float(view @ rotation[:, 2]) / float(np.linalg.norm(view))
        if edge >= MIN_EDGE and facing >= math.cos(MAX_ANGLE):
            visible.add(tag.id)
    return visible
