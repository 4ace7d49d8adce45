"""What a sight of the map says about the body's pose and about how the camera is mounted."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from star_apriltag.vision.pose import NEAREST, Motion, View
from star_apriltag.vision.rigid import Pose, cross
from star_core import Array

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
        residual, by_pose, by_mounting = reprojection(
            pose.rotation().matrix(), pose.translation(), extra, view, motion, mounting
        )
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(by_pose)
            jacobians[1] = np.asfortranarray(by_mounting)
        return residual

    noise: Any = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Huber.Create(HUBER),
        gtsam.noiseModel.Isotropic.Sigma(view.rays.size, view.deviation),
    )
    return gtsam.CustomFactor(noise, [pose_key, mounting_key], error)


def reprojection(
    rotation: Array, translation: Array, extra: Array, view: View, motion: Motion, mounting: Pose
) -> tuple[Array, Array, Array]:
    """Return the (2 K,) residual of K points, and its (2 K, 6) and (2 K, 3) derivatives.

    With the body's rotation R and place t, a point P is at ``b = R'(P - t)`` in the body when the
    middle row is read, and at ``b + d (cross(b, w) - v)`` when its own row is, d later; then
    at ``E C'(b - l)`` in the camera, where `mounting` is C and l. The derivatives are by a turn and
    a shift in the body's own frame, gtsam's tangent of `Pose3`, and by a turn of the camera in its.
    """
    body = (view.points - translation) @ rotation
    delay, spin = view.delay[:, None], cross(motion.rates)
    seen = body + delay * (body @ spin - motion.velocity)
    turned = (seen - mounting.position) @ mounting.rotation
    camera = turned @ extra.T
    depth = np.maximum(camera[:, 2], NEAREST)  # behind the camera there is no image: keep it finite
    point = camera[:, :2] / depth[:, None]
    residual = (point - view.rays).ravel()

    project = np.zeros((len(point), 2, 3))
    project[:, 0, 0] = project[:, 1, 1] = 1 / depth
    project[:, :, 2] = -point / depth[:, None]
    by_camera = project @ extra
    by_mounting = -by_camera @ cross(turned)
    by_body = by_camera @ mounting.rotation.T
    by_body = by_body - delay[:, :, None] * (by_body @ spin)
    by_pose = np.concatenate([by_body @ cross(body), -by_body], axis=2)
    return residual, by_pose.reshape(-1, 6), by_mounting.reshape(-1, 3)
