"""What a sight of the map says about the body's pose and about how the camera is mounted."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from star_apriltag.vision.body_pose import Motion, View, reproject
from star_core import Array, Pose, skew

HUBER = 1.5
"""Residual of a whole view, in deviations, from which on it weighs less."""


def factor(
    pose_key: int, mounting_key: int, view: View, motion: Motion, mounting: Pose
) -> gtsam.CustomFactor:
    """Return the reprojection of a tag's corners, or of one point, as one robust factor.

    Its variables are the body's `gtsam.Pose3` in the map and a small `gtsam.Rot3`, by which the
    camera is turned against `mounting` in its own frame.
    """

    def error(_factor: object, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        pose = values.atPose3(pose_key)
        extra = values.atRot3(mounting_key).matrix()
        camera = Pose(mounting.rotation @ extra.T, mounting.position)
        seen, residual, by_pose, by_camera = reproject(
            Pose(pose.rotation().matrix(), pose.translation()), view, motion, camera
        )
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(by_pose)
            jacobians[1] = np.asfortranarray(_by_mounting(seen, by_camera, extra))
        return residual

    noise: Any = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Huber.Create(HUBER),
        gtsam.noiseModel.Isotropic.Sigma(view.rays.size, view.deviation),
    )
    return gtsam.CustomFactor(noise, [pose_key, mounting_key], error)


def _by_mounting(seen: Array, by_camera: Array, extra: Array) -> Array:
    """Return the (2 K, 3) derivatives by a turn of the camera in its own frame."""
    turned: Array = -(by_camera @ skew(seen) @ extra).reshape(-1, 3)
    return turned
