"""The body's pose, from tags at known positions, and whether to believe it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from star_apriltag.vision.perspective import perspective
from star_core import Array, Pose
from star_core.toolkit import skew

LEVEL_STD: Final = math.radians(2.0)
"""Of the on-board estimator's roll and pitch, rad; large, because their errors last."""

HEIGHT_STD: Final = 0.02  # m, of its height
MAX_STEPS: Final = 10
CONVERGED: Final = 1e-4  # rad and m: after a step that small, the next is below 1e-6
MIN_DEPTH: Final = 0.02  # m, before the camera; no lens focuses nearer


class View(NamedTuple):
    """A measurement of the map in one image: a tag's four corners, or one point."""

    points: Array  # (K, 3) in the map, m
    rays: Array  # (K, 2) at which they were seen
    deviation: float  # standard deviation of each coordinate of the rays
    delay: Array  # (K,) when each point's row was read, after the image's middle row, s


class Motion(NamedTuple):
    """Motion of the body while the rows of an image are read, in its own frame."""

    velocity: Array  # (3,) m/s
    rates: Array  # (3,) rad/s


AT_REST: Final = Motion(np.zeros(3), np.zeros(3))


@dataclass(frozen=True, slots=True)
class Prediction:
    """State of an agent when an image was taken, before the image is analyzed."""

    pose: Pose  # of the body in the map; tilt and height are those of the on-board estimator
    covariance: Array  # (3, 3) of x, y and yaw, m and rad
    motion: Motion = AT_REST  # of the body
    # (3, 3) rotation of the camera against its mounting, in its own frame
    camera_turn: Array = field(default_factory=lambda: np.eye(3))

    def camera(self, mounting: Pose) -> Pose:
        """Return the pose in the body of a camera with that mounting."""
        return Pose(mounting.rotation @ self.camera_turn.T, mounting.position)


@dataclass(frozen=True, slots=True)
class Fix:
    """An estimated pose."""

    pose: Pose  # of the body in the map
    # (6, 6) of a rotation and then a shift in the body's own frame, rad and m: the tangent of
    # gtsam's `Pose3`. It includes the errors of tilt and height
    covariance: Array
    misfit: float  # root mean square of the points' residuals, in standard deviations


def refine(
    pose: Pose,
    views: Sequence[View],
    mounting: Pose,
    level: Pose | None = None,
    motion: Motion = AT_REST,
) -> Fix | None:
    """Return the body pose with the least squared residuals, or None if there is none.

    All six degrees of freedom are estimated, by Gauss-Newton.

    Args:
        pose: Of the body in the map, to begin from.
        views: At least one.
        mounting: Camera in the body.
        level: A pose whose tilt and height are a prior, or None.
        motion: Of the body.
    """
    view = View(
        np.concatenate([view.points for view in views]),
        np.concatenate([view.rays for view in views]),
        1.0,
        np.concatenate([view.delay for view in views]),
    )
    weight = np.concatenate([np.full(view.rays.size, 1 / view.deviation) for view in views])
    for _ in range(MAX_STEPS):
        camera, residual, by_pose, _ = reproject(pose, view, motion, mounting)
        if not camera[:, 2].min() > MIN_DEPTH:
            return None
        residual *= weight
        jacobian = by_pose * weight[:, None]
        information = jacobian.T @ jacobian
        slope = -jacobian.T @ residual
        if level is not None:
            more, pull = _level_information(pose, level)
            information += more
            slope += pull
        try:
            covariance = np.linalg.inv(information)
        except np.linalg.LinAlgError:
            return None
        step = covariance @ slope
        pose = pose.moved(step)
        if np.abs(step).max() < CONVERGED:
            break
    else:
        return None
    if not np.isfinite(covariance).all():
        return None
    return Fix(pose, covariance, float(np.sqrt(residual @ residual / len(residual))))


def reproject(
    pose: Pose, view: View, motion: Motion, mounting: Pose
) -> tuple[Array, Array, Array, Array]:
    """Return the points of a view as seen from a body pose, and the derivatives.

    With the body's rotation R and position t, a point P is at ``b = R'(P - t)`` in the body when
    the middle row is read, and at ``b + d (cross(b, w) - v)`` when its own row is, d later; then at
    ``C'(b - l)`` in the camera, where `mounting` is C and l.

    Args:
        pose: Of the body in the map.
        view: K points.
        motion: Of the body.
        mounting: Camera in the body.

    Returns:
        The (K, 3) points in the camera, m, the (2 K,) residuals of their rays, their (2 K, 6)
        derivatives by a rotation and a shift of the body in its own frame, gtsam's tangent of
        `Pose3`, and their (K, 2, 3) derivatives by the points in the camera.
    """
    body = (view.points - pose.position) @ pose.rotation
    delay, spin = view.delay[:, None], skew(motion.rates)
    exposed = body + delay * (body @ spin - motion.velocity)
    camera = (exposed - mounting.position) @ mounting.rotation
    rays, by_camera = perspective(np.maximum(camera, _IN_FRONT))
    by_body = by_camera @ mounting.rotation.T
    by_body -= delay[:, :, None] * (by_body @ spin)
    by_pose = np.concatenate([by_body @ skew(body), -by_body], axis=2)
    return camera, (rays - view.rays).ravel(), by_pose.reshape(-1, 6), by_camera


def _level_information(pose: Pose, level: Pose) -> tuple[Array, Array]:
    """Return the (6, 6) information and the (6,) slope of the prior on tilt and height."""
    up = pose.rotation[2]
    x, y, z = (up / LEVEL_STD).tolist()
    jacobian = np.zeros((3, 6))
    jacobian[0, 1:3] = -z, y
    jacobian[1, 0:3:2] = z, -x
    jacobian[2, 3:] = up / HEIGHT_STD
    off = (level.rotation[2] - up) / LEVEL_STD
    off[2] = (level.position[2] - pose.position[2]) / HEIGHT_STD
    return jacobian.T @ jacobian, off @ jacobian


_IN_FRONT = np.array([-np.inf, -np.inf, MIN_DEPTH])  # keeps points behind the camera finite


MAX_SURPRISE: Final = 25.0  # squared standard deviations in x, y and yaw
MAX_MISFIT: Final = 6.0  # standard deviations of a corner
MAX_JOINT_MISFIT: Final = 15.0  # likewise, of several tags together: maps are not exact
POSITION_STD: Final = 0.03  # m, of a fix in x and in y
POSITION_STD_PER_METER: Final = 0.02  # m for each meter between camera and tag
YAW_STD: Final = math.radians(2.0)  # rad, of a fix


class Verdict(StrEnum):
    """Whether a tag is used."""

    ACCEPTED = "accepted"
    UNSOLVED = "no pose fits its corners"
    TILTED = "its pose is tilted against the on-board estimate"
    MISFIT = "its corners do not fit its pose"
    ELSEWHERE = "its pose is far from the predicted one"
    INCONSISTENT = "it does not fit the other tags of its image"


def surprise(pose: Pose, distance: float, expected: Pose, covariance: Array) -> float:
    """Return the squared Mahalanobis distance of a body pose from the expected one.

    Args:
        pose: From a tag.
        distance: From the camera to the tag, m.
        expected: Body in the map.
        covariance: (3, 3) of the expected x, y and yaw, m and rad. Only the block of x and y and
            the variance of yaw are used.
    """
    spread = POSITION_STD + POSITION_STD_PER_METER * distance
    x, y = (pose.position[:2] - expected.position[:2]).tolist()
    turn = math.remainder(pose.yaw - expected.yaw, math.tau)
    a, b = covariance[0, 0] + spread**2, covariance[0, 1]
    c = covariance[1, 1] + spread**2
    position = (c * x * x - 2 * b * x * y + a * y * y) / (a * c - b * b)
    return float(position + turn**2 / (covariance[2, 2] + YAW_STD**2))


def judge(fix: Fix, distance: float, expected: Pose, covariance: Array) -> tuple[Verdict, float]:
    """Return whether a fix from one tag is used, and its `surprise`; arguments as there."""
    far = surprise(fix.pose, distance, expected, covariance)
    if not fix.misfit <= MAX_MISFIT:
        return Verdict.MISFIT, far
    if not far <= MAX_SURPRISE:  # so that a covariance that is not finite accepts nothing
        return Verdict.ELSEWHERE, far
    return Verdict.ACCEPTED, far


def tilt(pose: Pose, up: Array) -> float:
    """Return the angle between a body pose's up and `up` (3,) in the body frame, rad."""
    across = skew(pose.rotation[2]) @ up
    return math.atan2(math.sqrt(across @ across), float(pose.rotation[2] @ up))
