"""What the drones' own estimators are told, for those that are to hold the map frame themselves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from star_apriltag.reckoning import Belief
from star_core import Corrections, Telemetry, Transform

# An estimator takes the errors of one correction after the other for independent ones, which they
# are not: it is told of more deviation than there is.
LEAST: Final = 0.03  # m
LEAST_YAW: Final = math.radians(1.0)  # rad
TIMES: Final = 1.5
JUMP: Final = 0.3  # m: what is farther off is not for an estimator to swallow


class Feedback:
    """Draws each agent's odometry frame back to where it lay at the start.

    Nothing may be counted twice: an agent is told only of new fixes, carried to now, with its own
    roll and pitch; and the localizer builds on velocities, which corrections leave alone. Where an
    agent is found more than `JUMP` away, its frame is taken to lie where it lies now.

    Args:
        frames: Where the odometry frames lie at the start.
        turns: Whether agents are told of their attitudes too.
    """

    def __init__(self, frames: Transform, *, turns: bool = True) -> None:
        self._turns = turns
        self._yaw = frames.yaw.copy()
        self._translation = frames.translation.copy()

    def corrections(
        self,
        fixed: Iterable[int],
        beliefs: Sequence[Belief],
        frames: Transform,
        telemetry: Telemetry,
    ) -> Corrections:
        """Return what to tell the agents in rows `fixed`, which have a new fix.

        Args:
            fixed: Their rows.
            beliefs: Where each agent is now.
            frames: Where the odometry frames lie now.
            telemetry: What the agents believe now.
        """
        rows, positions, attitudes, deviations, yaws = [], [], [], [], []
        for row in sorted(set(fixed)):
            belief = beliefs[row]
            held = Transform(self._yaw[[row]], self._translation[[row]]).inverse()
            (position,) = held.apply(belief.position[None])
            if not math.dist(position[:2], telemetry.position[row, :2]) <= JUMP:
                self._yaw[row] = frames.yaw[row]
                self._translation[row] = frames.translation[row]
                continue
            rows.append(row)
            positions.append(position)
            turns = [belief.yaw - self._yaw[row], belief.pitch, belief.roll]
            attitudes.append(Rotation.from_euler("ZYX", turns).as_quat())
            spread = math.sqrt(float(np.linalg.eigvalsh(belief.covariance[:2, :2])[-1]))
            deviations.append(max(LEAST, TIMES * spread))
            yaw = max(LEAST_YAW, TIMES * math.sqrt(belief.covariance[3, 3]))
            yaws.append(yaw if self._turns else math.inf)
        if not rows:
            return Corrections.none()
        return Corrections(
            agent=np.array(rows),
            position=np.array(positions),
            attitude=np.array(attitudes),
            position_deviation=np.array(deviations),
            attitude_deviation=np.array(yaws),
        )
