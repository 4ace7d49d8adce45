"""Detects from consecutive images that an agent is far from its estimated position."""

from __future__ import annotations

import cmath
import math
from typing import Final, NamedTuple

import gtsam

from star_apriltag.odometry_track import OdometryTrack
from star_core import Array

MIN_IMAGES: Final = 4  # consecutive ones that must agree
MAX_DISTANCE: Final = 0.15  # m between their positions
MAX_TURN: Final = math.radians(10.0)  # rad between their headings
MAX_TIME: Final = 3.0  # s between the first and the last


class Claim(NamedTuple):
    """Pose of the agent according to one image alone."""

    time: float  # of its exposure, s
    pose: gtsam.Pose3  # body in the map
    covariance: Array  # (6, 6) in gtsam's tangent


class Relocation:
    """Collects the claims of images whose tags were all rejected, until enough of them agree."""

    def __init__(self) -> None:
        self._claims: list[Claim] = []

    def forget(self) -> None:
        """Begin again, after an image was accepted."""
        self._claims.clear()

    def consider(self, claim: Claim, track: OdometryTrack) -> bool:
        """Add a claim; return whether the previous ones agree with it, given the odometry."""
        self._claims = [
            old
            for old in self._claims
            if claim.time - old.time < MAX_TIME and _agree(old, claim, track)
        ]
        self._claims.append(claim)
        if len(self._claims) < MIN_IMAGES:
            return False
        self._claims.clear()
        return True


def _agree(old: Claim, new: Claim, track: OdometryTrack) -> bool:
    motion = track.between(old.time, new.time)
    yaw = old.pose.rotation().yaw()
    turned = new.pose.rotation().yaw() - yaw - motion.turn
    x, y, _ = new.pose.translation() - old.pose.translation()
    apart = complex(x, y) - motion.shift * cmath.rect(1.0, yaw)
    return abs(apart) < MAX_DISTANCE and abs(math.remainder(turned, math.tau)) < MAX_TURN
