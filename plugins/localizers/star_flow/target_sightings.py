"""Positions of targets, from tags that cameras detected on board, at the pose of each exposure."""

from __future__ import annotations

import logging
import math
from bisect import bisect_right
from collections import deque
from typing import Any, Final, NamedTuple

import numpy as np

from star_core import Array, Pose, Scene, Sightings, Telemetry, Transform
from star_core.toolkit import (
    CameraModel,
    rotation_from_quaternion,
    rotation_from_vector,
    square_corners,
    upright_misfit,
)
from star_flow.drift import heading_variance

CORNER_STD: Final = 0.3  # px, of a corner in u and in v
DIRECTION_STD: Final = math.radians(1.0)  # rad, by mounting and attitude
MAX_MISFIT: Final = 3.0  # standard deviations of a corner, root mean square

log = logging.getLogger(__name__)


class TargetSightings:
    """Locates targets in the map.

    The error of a target's position includes that of the agent that sees it, since no landmark
    corrects it. No image is processed. The rows of an image count as exposed at once; rolling
    shutter moves a target by some millimeters.

    Args:
        scene: Agents with their cameras. Of the world's targets the numbers and sizes of the tags
            are used, not the positions.
        latency: Time from exposure to arrival, for detections without a timestamp, s.
    """

    def __init__(self, scene: Scene, *, latency: float) -> None:
        self._models = [
            None if agent.camera is None else CameraModel(agent.camera) for agent in scene.agents
        ]
        self._sizes = {tag.id: tag.size for tag in scene.world.targets}
        self._latency = latency
        self._exact = scene.exact_odometry
        self._history = PoseHistory()
        self._warned = False
        self.idle = not self._sizes or not any(self._models)

    def locate(
        self, telemetry: Telemetry, map_from_odom: Transform, position: Array, covariance: Array
    ) -> Sightings:
        """Return the targets among the detections that arrived.

        Args:
            telemetry: Of the tick.
            map_from_odom: Of the agents' odometry frames.
            position: (N, 3) of the agents, map frame, m.
            covariance: (N, 3, 3) of that, m².
        """
        if self.idle:
            return Sightings.none()
        self._history.add(telemetry, position, covariance)
        if len(telemetry.frames.agent) and not self._warned:
            self._warned = True
            log.warning(
                "flow: images are not processed, so no target is seen; use localizer apriltag, or a"
                " camera with on-board detection: transport {use: sim, camera: {mode: geometric}}"
            )
        detections = telemetry.detections
        taken = np.where(
            np.isfinite(detections.taken), detections.taken, detections.arrived - self._latency
        )
        sightings = []
        for k in np.flatnonzero(np.isin(detections.tag, list(self._sizes))).tolist():
            row, tag, time = int(detections.agent[k]), int(detections.tag[k]), float(taken[k])
            target = self._target(row, tag, time, detections.corners[k], map_from_odom.yaw[row])
            if target is not None:
                sightings.append((row, tag, time, *target))
        columns: Any = map(np.array, zip(*sightings, strict=True))
        return Sightings(*columns) if sightings else Sightings.none()

    def _target(
        self, row: int, tag: int, taken: float, corners: Array, frame_yaw: float
    ) -> tuple[Array, float, Array] | None:
        """Return a target's position, yaw and covariance in the map, if they can be computed."""
        model, pose = self._models[row], self._history.at(row, taken)
        if model is None or pose is None:
            return None
        position, attitude, covariance = pose
        level = rotation_from_vector(np.array([0.0, 0.0, frame_yaw]))
        camera = Pose(level @ rotation_from_quaternion(attitude), position) @ model.mounting
        deviation = CORNER_STD / min(model.camera.matrix[:2])
        rays = model.undistort(corners)
        square = square_fix(rays, self._sizes[tag], camera.rotation[2], deviation)
        if square is None:
            return None
        target = camera @ square.pose
        away = target.position - position
        across = np.array([-away[1], away[0], 0.0])
        spread = camera.rotation @ square.covariance @ camera.rotation.T + covariance
        if not self._exact:
            spread += heading_variance(taken) * np.outer(across, across)
        spread += DIRECTION_STD**2 * (away @ away * np.eye(3) - np.outer(away, away))
        return target.position, target.yaw, spread


class SquareFix(NamedTuple):
    """The pose of a square in the camera's frame."""

    pose: Pose  # of the square
    covariance: Array  # (3, 3) of its position, m²
    surprise: float  # sum of the squared residuals of its corners, in standard deviations


def square_fix(rays: Array, size: float, up: Array, deviation: float) -> SquareFix | None:
    """Return the pose of a square by least squares, or None if its corners are not a square's.

    Of the two poses that a small square may have, a level one, as of a sheet on the floor, is
    preferred.

    Args:
        rays: (4, 2) x / z and y / z of its corners: bottom left, bottom right, top right, top left.
        size: Its edge, m.
        up: (3,) unit vector against gravity in the camera's frame.
        deviation: Standard deviation of each coordinate of the rays.
    """
    from star_core.toolkit import (
        square_poses,  # OpenCV, which a flight without targets does not need
    )

    guesses = square_poses(rays, size) + square_poses(rays + _NUDGES, size)
    fixes = [fix for pose, _ in guesses if (fix := _refined(pose, rays, size, deviation))]
    return min(fixes, key=lambda fix: upright_misfit(fix.pose, fix.surprise, up), default=None)


def _refined(pose: Pose, rays: Array, size: float, deviation: float) -> SquareFix | None:
    """Return the best pose near a first one, or None if it does not fit."""
    import cv2

    points, identity = square_corners(size), np.eye(3)
    turn, position = cv2.solvePnPRefineLM(
        points, rays, identity, None, cv2.Rodrigues(pose.rotation)[0], pose.position[:, None]
    )
    projected, jacobian = cv2.projectPoints(points, turn, position, identity, None)
    residual = (rays - np.asarray(projected, np.float64).reshape(4, 2)).ravel()
    surprise = float(residual @ residual) / deviation**2
    by_pose = np.asarray(jacobian, np.float64)[:, :6]  # rotation vector, then position
    if not (surprise <= len(residual) * MAX_MISFIT**2 and position[2] > size / 2):
        return None
    try:
        covariance = np.asarray(np.linalg.inv(by_pose.T @ by_pose)[3:, 3:], np.float64)
    except np.linalg.LinAlgError:  # seen from its edge
        return None
    rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
    refined = Pose(rotation, np.asarray(position, np.float64).ravel())
    return SquareFix(refined, covariance * deviation**2, surprise)


_NUDGES = 1e-6 * np.arange(8.0).reshape(4, 2) ** 2  # some exact corners have no good first pose


DURATION: Final = 6.0  # s, for which poses are kept
EXTRAPOLATION: Final = 0.1  # s, by which a time may be newer than the newest report


class Poses(NamedTuple):
    """Poses of all agents at one tick."""

    tick: float  # mission time, s
    time: Array  # (N,) of each agent's report, s
    position: Array  # (N, 3) in the map, m
    attitude: Array  # (N, 4) unit quaternion x, y, z, w from the body to the odometry frame
    covariance: Array  # (N, 3, 3) of the position, m²


class PoseHistory:
    """Keeps the poses of the last `DURATION` seconds."""

    def __init__(self) -> None:
        self._history: deque[Poses] = deque()

    def add(self, telemetry: Telemetry, position: Array, covariance: Array) -> None:
        """Add the agents' current positions: (N, 3) m in the map, and (N, 3, 3) m²."""
        now, reported = telemetry.time, telemetry.time - telemetry.age
        self._history.append(Poses(now, reported, position, telemetry.attitude, covariance))
        while self._history[0].tick < now - DURATION:
            self._history.popleft()

    def at(self, row: int, time: float) -> tuple[Array, Array, Array] | None:
        """Return one agent's pose at `time`, s, or None if it is not known.

        Position (3,) and attitude (4,) are interpolated between reports; the covariance (3, 3) is
        that of the later one.
        """
        poses = [pose for pose in self._history if np.isfinite(pose.time[row])]
        times = [pose.time[row] for pose in poses]
        if not times or not times[0] <= time <= times[-1] + EXTRAPOLATION:
            return None
        after = min(bisect_right(times, time), len(times) - 1)
        earlier, later = poses[max(after - 1, 0)], poses[after]
        interval = later.time[row] - earlier.time[row]
        share = min(1.0, (time - earlier.time[row]) / interval) if interval > 0 else 1.0
        first, last = earlier.attitude[row], later.attitude[row]
        attitude = (1 - share) * first + share * last * (1.0 if first @ last >= 0 else -1.0)
        position = (1 - share) * earlier.position[row] + share * later.position[row]
        if not np.isfinite(attitude).all():
            return None
        return position, attitude / np.linalg.norm(attitude), later.covariance[row]
