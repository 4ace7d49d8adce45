"""What the drones' own estimators are told, for those that are to hold the map frame themselves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from star_apriltag.dead_reckoning import Belief
from star_core import Corrections, Telemetry, Transform, quaternion_from_euler

# An estimator takes the errors of one correction after the other for independent ones, which they
# are not: it is told of more deviation than there is.
LEAST: Final = 0.03  # m
LEAST_YAW: Final = math.radians(1.0)  # rad
TIMES: Final = 1.5
JUMP: Final = 0.3  # m, above which the frame is moved and the estimator is not corrected
RETURN: Final = 0.01  # m per fix, by which a frame that was moved returns to its initial position
RETURN_YAW: Final = math.radians(0.1)  # rad per fix


class Feedback:
    """Corrections that keep each agent's odometry frame where it was at the start.

    Nothing may be counted twice: an agent is only sent new fixes, carried to now, with its own
    roll and pitch; and the localizer builds on velocities, which corrections leave alone. An
    estimate that is more than `JUMP` off is not corrected at once: its frame is moved to where the
    estimate is right, and returns from there fix by fix, no faster than the agent can follow.

    Without attitudes the estimators' headings are corrected by positions and motion, as a Kalman
    filter does that integrates body velocities along its heading. Then a frame is moved, but not
    turned: what its heading is off is for the estimator to find.

    Args:
        frames: Odometry frames at the start.
        turns: Whether attitudes are sent too.
    """

    def __init__(self, frames: Transform, *, turns: bool = True) -> None:
        self._turns = turns
        self._start = frames
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
            self._return(row)
            (position,) = self._held(row).inverse().apply(belief.position[None])
            if not math.dist(position[:2], telemetry.position[row, :2]) <= JUMP:
                if self._turns:
                    self._yaw[row] = frames.yaw[row]
                reported = frames.of(np.array([row])).inverse().apply(belief.position[None])
                self._translation[row] = (belief.position - self._held(row).turn(reported))[0]
                continue
            rows.append(row)
            positions.append(position)
            yaw = belief.yaw - self._yaw[row]
            attitudes.append(quaternion_from_euler(belief.roll, belief.pitch, yaw))
            spread = math.sqrt(float(np.linalg.eigvalsh(belief.covariance[:2, :2])[-1]))
            deviations.append(max(LEAST, TIMES * spread))
            turn = max(LEAST_YAW, TIMES * math.sqrt(belief.covariance[3, 3]))
            yaws.append(turn if self._turns else math.inf)
        if not rows:
            return Corrections.none()
        return Corrections(
            agent=np.array(rows),
            position=np.array(positions),
            attitude=np.array(attitudes),
            position_deviation=np.array(deviations),
            attitude_deviation=np.array(yaws),
        )

    def _held(self, row: int) -> Transform:
        """Return the odometry frame that an agent is corrected to."""
        return Transform(self._yaw[[row]], self._translation[[row]])

    def _return(self, row: int) -> None:
        """Move a frame one step towards its initial pose."""
        off = self._start.translation[row] - self._translation[row]
        self._translation[row] += off * min(1.0, RETURN / max(RETURN, float(np.linalg.norm(off))))
        turn = math.remainder(self._start.yaw[row] - self._yaw[row], math.tau)
        self._yaw[row] += min(max(turn, -RETURN_YAW), RETURN_YAW)
