"""Rejects poses that are too far from the prediction."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Final

from star_apriltag.vision.body_pose import Fix
from star_core import Array, Pose, skew

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
