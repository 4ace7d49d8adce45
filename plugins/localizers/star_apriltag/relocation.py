"""When the images say, again and again, that the agent is somewhere else."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Final

import gtsam

from star_apriltag.odometry_track import Track
from star_core import Array

IMAGES: Final = 4  # one after the other that must agree
APART: Final = 0.15  # m, by which they may differ
TURNED: Final = math.radians(10.0)  # rad
LONGEST: Final = 3.0  # s between the first and the last


@dataclass(frozen=True, slots=True)
class Claim:
    """Where one image alone says that the agent is.

    Attributes:
        time: At which it was taken, s.
        pose: Body in the map.
        covariance: (6, 6) in gtsam's tangent.
    """

    time: float
    pose: gtsam.Pose3
    covariance: Array


class Relocation:
    """Collects claims of images whose tags were all refused, until enough of them agree."""

    def __init__(self) -> None:
        self._claims: list[Claim] = []

    def forget(self) -> None:
        """An image was believed: begin again."""
        self._claims.clear()

    def consider(self, claim: Claim, track: Track) -> Claim | None:
        """Take in a claim; return it if the last few agree with it through the odometry."""
        self._claims = [
            old
            for old in self._claims
            if claim.time - old.time < LONGEST and _agree(old, claim, track)
        ]
        self._claims.append(claim)
        if len(self._claims) < IMAGES:
            return None
        self._claims.clear()
        return claim


def _agree(old: Claim, new: Claim, track: Track) -> bool:
    motion = track.between(old.time, new.time)
    yaw = old.pose.rotation().yaw()
    turned = new.pose.rotation().yaw() - yaw - motion.turn
    x, y, _ = new.pose.translation() - old.pose.translation()
    apart = complex(x, y) - motion.shift * cmath.rect(1.0, yaw)
    return abs(apart) < APART and abs(math.remainder(turned, math.tau)) < TURNED
