"""Corrections of the drones' own estimators, which then keep the map frame themselves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np

from star_apriltag.dead_reckoning import AgentState
from star_core import Corrections, Telemetry, Transform, quaternion_from_euler

# An estimator treats the errors of consecutive corrections as independent, which they are not, so
# the standard deviations sent are increased.
MIN_STD: Final = 0.03  # m
MIN_YAW_STD: Final = math.radians(1.0)  # rad
STD_FACTOR: Final = 1.5
MAX_ERROR: Final = 0.3  # m, above which the frame is moved and the estimator is not corrected
RETURN_STEP: Final = 0.01  # m per fix, by which a frame that was moved returns to its initial pose
RETURN_TURN: Final = math.radians(0.1)  # rad per fix


class Feedback:
    """Corrections that keep each agent's odometry frame at its initial pose.

    To count nothing twice, an agent is only sent new fixes, propagated to the current time, with
    its own roll and pitch; and the localizer uses velocities, which corrections do not change. An
    estimate with an error above `MAX_ERROR` is not corrected at once: its frame is moved to where
    the estimate is right, and returns from there fix by fix, slowly enough for the agent to follow.

    Without attitudes the estimators correct their headings by positions and motion, like a Kalman
    filter that integrates body velocities along its heading. Then a frame is moved, but not turned:
    the estimator itself has to find the error of its heading.

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
        states: Sequence[AgentState],
        frames: Transform,
        telemetry: Telemetry,
    ) -> Corrections:
        """Return the corrections of the agents in rows `fixed`, which have a new fix."""
        found: list[tuple[Any, ...]] = []
        for row in sorted(set(fixed)):
            state = states[row]
            self._step_back(row)
            frame = Transform(self._yaw[[row]], self._translation[[row]])
            (position,) = frame.inverse().apply(state.position[None])
            if not math.dist(position[:2], telemetry.position[row, :2]) <= MAX_ERROR:
                if self._turns:
                    self._yaw[row] = frames.yaw[row]
                reported = frames.of(np.array([row])).inverse().apply(state.position[None])
                frame = Transform(self._yaw[[row]], self._translation[[row]])
                self._translation[row] = (state.position - frame.turn(reported))[0]
                continue
            attitude = quaternion_from_euler(state.roll, state.pitch, state.yaw - self._yaw[row])
            spread = math.sqrt(float(np.linalg.eigvalsh(state.covariance[:2, :2])[-1]))
            turn = max(MIN_YAW_STD, STD_FACTOR * math.sqrt(state.covariance[3, 3]))
            deviations = max(MIN_STD, STD_FACTOR * spread), turn if self._turns else math.inf
            found.append((row, position, attitude, *deviations))
        columns: Any = map(np.array, zip(*found, strict=True))
        return Corrections(*columns) if found else Corrections.none()

    def _step_back(self, row: int) -> None:
        """Move a frame one step towards its initial pose."""
        off = self._start.translation[row] - self._translation[row]
        distance = max(RETURN_STEP, float(np.linalg.norm(off)))
        self._translation[row] += off * min(1.0, RETURN_STEP / distance)
        turn = math.remainder(self._start.yaw[row] - self._yaw[row], math.tau)
        self._yaw[row] += min(max(turn, -RETURN_TURN), RETURN_TURN)
