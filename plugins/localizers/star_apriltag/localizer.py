"""Localizer ``apriltag``: odometry, corrected by AprilTags; corrections for on-board estimators."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from star_apriltag.agent_estimator import CameraReport, Settings
from star_apriltag.agent_group import TickInput, TickOutput
from star_apriltag.dead_reckoning import AgentState, DeadReckoner
from star_apriltag.odometry_track import ReportOdometry
from star_apriltag.worker_pool import WorkerPool, default_processes
from star_core import (
    Corrections,
    Detections,
    Estimate,
    Image,
    Scene,
    Sightings,
    Supervisor,
    Telemetry,
    Transform,
)
from star_core.toolkit import SurfaceHeights, SurfaceReport, quaternion_from_euler

CLOCK_TOLERANCE: Final = 0.02  # s, by which an image may be newer than the newest report


class AprilTag:
    """Localizes agents by their odometry and by AprilTags.

    Unless there is feedback, nothing is sent to the drones: each flies in its own odometry frame,
    and `map_from_odom` changes. The arguments beside the scene are the options of the schema.
    """

    def __init__(
        self,
        scene: Scene,
        settings: Settings,
        *,
        processes: int | None,
        feedback: str,
        max_position_std: float,
        max_report_age: float,
    ) -> None:
        self._reckoners = [DeadReckoner(agent) for agent in scene.agents]
        self._odometry = ReportOdometry(len(scene.agents))
        self._latency = settings.latency
        self._images: dict[int, Image | None] = {}  # the last one, by row
        self._max_position_std = max_position_std
        self._max_report_age = max_report_age
        self._frames = Transform(
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents]),
        )
        self._surfaces = SurfaceHeights(scene)
        self._last = self._frames.translation, np.zeros((len(scene.agents), 3, 3))
        self._feedback = (
            None if feedback == "none" else Feedback(self._frames, turns=feedback == "extpose")
        )
        if processes is None:
            processes = default_processes(scene)
        self._pool = WorkerPool(scene, settings, processes)

    def close(self) -> None:
        """End the processes."""
        self._pool.close()

    def locate(self, telemetry: Telemetry) -> Estimate:
        below = self._surfaces.correct(telemetry, *self._last)
        odometry = self._odometry.complete(below.telemetry)
        motors = telemetry.state & int(Supervisor.FLYING) != 0
        images = tuple(filter(self._is_new, camera_reports(telemetry, self._latency)))
        output = self._pool.update(TickInput(telemetry.time, odometry, images, motors))
        for row, anchor in output.anchors.items():
            self._reckoners[row].anchor = anchor
        for row, reckoner in enumerate(self._reckoners):
            rows = np.flatnonzero(odometry.agent == row)
            reckoner.add_odometry(odometry, rows, motors=bool(motors[row]))
        states = [reckoner.at(telemetry.time) for reckoner in self._reckoners]
        estimate = self._estimate(telemetry, states, output, below)
        self._last = estimate.position, estimate.covariance
        if self._feedback is None or not output.fixed:
            return estimate
        fixed = output.fixed - self._odometry.silent  # velocities in reports contain corrections
        corrections = self._feedback.corrections(fixed, states, estimate.map_from_odom, telemetry)
        return replace(estimate, corrections=corrections)

    def _is_new(self, report: CameraReport) -> bool:
        """Return whether an image is not the same as the one before it: then its camera is stuck.

        Images of a scene at rest differ by their noise.
        """
        before, image = self._images.get(report.row), report.image
        self._images[report.row] = image
        return image is None or before is None or not np.array_equal(image, before)

    def _estimate(
        self,
        telemetry: Telemetry,
        states: list[AgentState],
        output: TickOutput,
        below: SurfaceReport,
    ) -> Estimate:
        position = np.array([state.position for state in states])
        yaw = np.array([math.remainder(state.yaw, math.tau) for state in states])
        covariance = np.array([state.covariance[:3, :3] for state in states])
        covariance[:, 2, 2] += below.variance
        reported = np.isfinite(telemetry.position.sum(axis=1) + telemetry.attitude.sum(axis=1))
        frame_yaw = yaw - telemetry.heading
        turned = Transform(frame_yaw, np.zeros_like(position)).turn(telemetry.position)
        self._frames = Transform(
            np.where(reported, frame_yaw, self._frames.yaw),
            np.where(reported[:, None], position - turned, self._frames.translation),
        )
        located = np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]) <= self._max_position_std
        located[self._pool.lost] = False
        return Estimate(
            time=telemetry.time,
            position=position,
            velocity=np.array([state.velocity for state in states]),
            yaw=yaw,
            covariance=covariance,
            valid=located & reported & (telemetry.age <= self._max_report_age),
            map_from_odom=self._frames,
            sightings=_table(Sightings, output.sightings),
            detections=_table(Detections, output.detections),
            messages=below.messages,
            heights=below.heights,
        )


def _table(kind: Any, rows: tuple[tuple[Any, ...], ...]) -> Any:
    """Return a table of rows."""
    return kind(*map(np.array, zip(*rows, strict=True))) if rows else kind.none()


def camera_reports(telemetry: Telemetry, latency: float) -> tuple[CameraReport, ...]:
    """Return all images and batches of tags, in the order of their exposures.

    One with a time in the future is left out: its clock is wrong.
    """
    reports = []
    frames, detections = telemetry.frames, telemetry.detections
    no_tags = (np.zeros(0, np.int64), np.zeros((0, 4, 2)))
    taken = np.where(np.isfinite(frames.taken), frames.taken, frames.arrived - latency)
    stamped = np.isfinite(frames.taken).tolist()
    times = zip(frames.agent.tolist(), taken.tolist(), frames.arrived.tolist(), strict=True)
    for (row, time, arrived), image, has_time in zip(times, frames.image, stamped, strict=True):
        reports.append(CameraReport(row, time, image, *no_tags, arrived, has_time))
    taken = np.where(np.isfinite(detections.taken), detections.taken, detections.arrived - latency)
    for row, time in sorted(set(zip(detections.agent.tolist(), taken.tolist(), strict=True))):
        rows = (detections.agent == row) & (taken == time)
        arrived = float(detections.arrived[rows].max())
        tags, corners = detections.tag[rows], detections.corners[rows]
        has_time = bool(np.isfinite(detections.taken[rows]).all())
        reports.append(CameraReport(row, time, None, tags, corners, arrived, has_time))
    past = (report for report in reports if report.taken <= telemetry.time + CLOCK_TOLERANCE)
    return tuple(sorted(past, key=lambda report: (report.taken, report.row)))


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
        rows: list[tuple[Any, ...]] = []
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
            rows.append((row, position, attitude, *deviations))
        corrections: Corrections = _table(Corrections, tuple(rows))
        return corrections

    def _step_back(self, row: int) -> None:
        """Move a frame one step towards its initial pose."""
        off = self._start.translation[row] - self._translation[row]
        distance = max(RETURN_STEP, float(np.linalg.norm(off)))
        self._translation[row] += off * min(1.0, RETURN_STEP / distance)
        turn = math.remainder(self._start.yaw[row] - self._yaw[row], math.tau)
        self._yaw[row] += min(max(turn, -RETURN_TURN), RETURN_TURN)
