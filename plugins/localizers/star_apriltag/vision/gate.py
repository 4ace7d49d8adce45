"""Which fixes are too far from what was expected to be believed."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Final, NamedTuple

from star_apriltag.vision.body_pose import Fix
from star_core import Array, Pose, skew

MOST_SURPRISE: Final = 25.0  # squared deviations in x, y and yaw
MOST_MISFIT: Final = 6.0  # deviations of a corner
MOST_ODDS: Final = 15.0  # deviations of a corner, several tags together: maps are not exact
SPREAD: Final = 0.03  # m, of a fix in x and in y
SPREAD_PER_METRE: Final = 0.02  # m for each metre between camera and tag
YAW_SPREAD: Final = math.radians(2.0)  # rad, of a fix


class Verdict(StrEnum):
    """What became of a tag."""

    ACCEPTED = "accepted"
    UNSOLVED = "no pose fits its corners"
    TILTED = "its pose is tilted against the on-board estimate"
    MISFIT = "its corners do not fit its pose"
    ELSEWHERE = "its pose is far from where the agent is expected"
    AT_ODDS = "it does not fit the other tags of its image"


class Judgement(NamedTuple):
    """A verdict and how surprising the fix was, in squared deviations."""

    verdict: Verdict
    surprise: float


def surprise(pose: Pose, distance: float, expected: Pose, covariance: Array) -> float:
    """Return how far a body pose is from the expected one, in squared deviations.

    Args:
        pose: From a tag.
        distance: From the camera to the tag, m.
        expected: Body in the map.
        covariance: (3, 3) of the expected x, y and yaw, m and rad. Only the block of x and y and
            the variance of yaw are used.
    """
    spread = SPREAD + SPREAD_PER_METRE * distance
    off = pose.position[:2] - expected.position[:2]
    turned = math.remainder(pose.yaw - expected.yaw, math.tau)
    a, b = covariance[0, 0] + spread**2, covariance[0, 1]
    c = covariance[1, 1] + spread**2
    x, y = off.tolist()
    place = (c * x * x - 2 * b * x * y + a * y * y) / (a * c - b * b)
    return float(place + turned**2 / (covariance[2, 2] + YAW_SPREAD**2))


def judge(fix: Fix, distance: float, expected: Pose, covariance: Array) -> Judgement:
    """Say whether a fix from one tag is to be believed.

    Args:
        fix: From the tag and the on-board tilt and height.
        distance: From the camera to the tag, m.
        expected: Body in the map.
        covariance: (3, 3) of the expected x, y and yaw, m and rad.
    """
    far = surprise(fix.pose, distance, expected, covariance)
    if not fix.misfit <= MOST_MISFIT:
        return Judgement(Verdict.MISFIT, far)
    if not far <= MOST_SURPRISE:  # so that a covariance that is not finite is no licence
        return Judgement(Verdict.ELSEWHERE, far)
    return Judgement(Verdict.ACCEPTED, far)


def tilt(pose: Pose, up: Array) -> float:
    """Return the angle between a body pose's up and `up` (3,) in the body frame, rad."""
    across = skew(pose.rotation[2]) @ up
    return math.atan2(math.sqrt(across @ across), float(pose.rotation[2] @ up))
