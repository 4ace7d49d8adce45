"""A Kalman filter of one agent's state together with all errors that last.

Errors of the odometry, of the camera and of the survey are constant or change slowly. Taken as
noise, they would count as independent in every image; here they are part of the state, so that an
image determines them where it can, and leaves them uncertain where it cannot.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence
from copy import copy
from typing import Final, NamedTuple, Self

import numpy as np

from star_apriltag.dead_reckoning import (
    PITCH,
    ROLL,
    SLIP_X,
    SLIP_Y,
    STATES,
    YAW,
    Anchor,
    X,
    Y,
    Z,
    body_velocity,
    carried,
    level_rotation,
    rotation_about_z,
)
from star_apriltag.odometry_track import OdometryTrack
from star_apriltag.vision.body_pose import Motion, View, reproject
from star_core import Array, Pose, Tag
from star_core.toolkit import rotation_from_vector, skew

# State beyond that of dead reckoning, then six numbers for each landmark that was seen: rotation
# about its center, rad, and shift, m, in the map.
CAMERA: Final = slice(STATES, STATES + 3)  # rotation of the camera in its own frame, rad
FOCAL: Final = STATES + 3  # relative error of the focal length
LATENCY: Final = STATES + 4  # s, by which images without a timestamp are older than assumed
LANDMARK: Final = 6

LEVEL_STD: Final = math.radians(1.0)  # of the on-board tilt, constant in the body, rad
LEVEL_PER_TIME: Final = math.radians(0.1)  # rad/√s, by which that changes
FOCAL_STD: Final = 0.005
TIMESTAMP_STD: Final = 0.002  # s, of an image's timestamp
LATENCY_PER_TIME: Final = 0.0005  # s/√s, by which the mean latency of images changes
TILT_PER_SLIP: Final = 0.1  # rad/(m/s): on board, the same flow innovation corrects both
MAX_PASSES: Final = 3
CONVERGED: Final = 2e-3  # change of every state, after which derivatives are good enough
OUTLIER: Final = {2: 5.99, 8: 15.51}
"""Squared innovation, in standard deviations, above which a measurement of that size is weighted
down: 95 % of the chi-squared distribution."""


log = logging.getLogger(__name__)


class Deviations(NamedTuple):
    """Standard deviations of constant errors."""

    mounting: float  # rad, of the camera about each axis
    survey: float  # m, of landmarks along each axis
    survey_turn: float  # rad, about each axis
    latency: float  # s, of the mean latency; and of that of each image about the mean


class JointFilter:
    """Estimates an agent's state at its newest image.

    Args:
        start: State before take-off.
        mounting: Assumed pose of the camera in the body.
        tags: The map; tags of one landmark are on one sheet and err together.
        ground: z of the odometry frame in the map, m.
        deviations: Of constant errors.

    Attributes:
        camera_turn: (3, 3) estimated rotation of the camera against its mounting, in its own frame.
            It contains the constant error of the on-board tilt.
        latency: Estimated difference of the mean latency from the assumed one, s.
    """

    def __init__(
        self,
        start: Anchor,
        mounting: Pose,
        tags: Iterable[Tag],
        ground: float,
        deviations: Deviations,
    ) -> None:
        self._mounting = mounting
        self._ground = ground
        sheets: dict[str, list[Tag]] = {}
        for tag in tags:
            sheets.setdefault(tag.of, []).append(tag)
        self._sheets = {
            tag.id: (name, np.mean([member.position for member in members], axis=0))
            for name, members in sheets.items()
            for tag in members
        }
        self._rows: dict[str, int] = {}  # of the landmarks that were seen
        survey, turn = deviations.survey, deviations.survey_turn
        self._landmark = np.array([turn, turn, turn, survey, survey, survey]) ** 2
        camera = math.hypot(deviations.mounting, LEVEL_STD)
        self._jitter = deviations.latency
        constant = np.array([camera, camera, camera, FOCAL_STD, deviations.latency])
        self._time = start.time
        self._mean = np.concatenate([start.mean, np.zeros(len(constant))])
        self._covariance = np.diag(np.concatenate([np.zeros(STATES), constant**2]))
        self._covariance[:STATES, :STATES] = start.covariance
        self.camera_turn: Array = np.eye(3)
        self.latency = 0.0

    def copied(self) -> Self:
        """Return a filter that continues from this state by itself."""
        other = copy(self)
        vars(other).update(
            _rows=self._rows.copy(), _mean=self._mean.copy(), _covariance=self._covariance.copy()
        )
        return other

    @property
    def anchor(self) -> Anchor:
        """The agent's part of the state."""
        covariance = self._covariance[:STATES, :STATES].copy()
        return Anchor(self._time, self._mean[:STATES].copy(), covariance)

    def advance(self, time: float, track: OdometryTrack) -> None:
        """Continue to a later time by odometry."""
        anchor, moved = carried(self.anchor, time, track)
        self._covariance[CAMERA, CAMERA] += (time - self._time) * LEVEL_PER_TIME**2 * np.eye(3)
        self._covariance[LATENCY, LATENCY] += (time - self._time) * LATENCY_PER_TIME**2
        self._time = time
        self._mean[:STATES] = anchor.mean
        self._covariance[:STATES, STATES:] = moved @ self._covariance[:STATES, STATES:]
        self._covariance[STATES:, :STATES] = self._covariance[:STATES, STATES:].T
        self._covariance[:STATES, :STATES] = anchor.covariance

    def move(self, pose: Pose, covariance: Array) -> None:
        """Replace position and heading, since they were wrong.

        Args:
            pose: Of the body in the map.
            covariance: (6, 6) of a rotation and a shift of the body in its own frame.
        """
        by_step = np.zeros((3, 6))
        by_step[:2, 3:] = pose.rotation[:2]
        by_step[2, :3] = pose.rotation[2]
        rows = [X, Y, YAW]
        self._covariance[rows] = self._covariance[:, rows] = 0.0
        self._covariance[np.ix_(rows, rows)] = by_step @ covariance @ by_step.T
        self._mean[rows] = *pose.position[:2], pose.yaw

    def update(
        self,
        views: Sequence[tuple[int, View]],
        track: OdometryTrack,
        *,
        stamped: bool,
    ) -> None:
        """Correct the state by an image.

        An iterated extended Kalman filter: the derivatives are those at the corrected state.

        Args:
            views: Tags of the map with their numbers.
            track: Odometry up to the image, at least.
            stamped: Whether the image has a timestamp; else its time is that of its arrival less
                the assumed latency and `latency`.
        """
        time_std = TIMESTAMP_STD if stamped else self._jitter
        landmarks = [self._landmark_row(tag) for tag, _ in views]
        before, turn = self._mean, self.camera_turn
        noise = np.concatenate([np.full(view.rays.size, view.deviation**2) for _, view in views])
        weighted = False
        for _ in range(MAX_PASSES):
            residual, by_state, by_time = self._residuals(views, landmarks, track)
            if not stamped:
                by_state[:, LATENCY] = -by_time
                residual -= by_time * self._mean[LATENCY]
            late = time_std * by_time
            spread = by_state @ self._covariance @ by_state.T + np.outer(late, late)
            off = by_state @ (self._mean - before) - residual
            if not weighted:
                noise *= _weights(views, off, spread + np.diag(noise))
                weighted = True
            gain = np.linalg.solve(spread + np.diag(noise), by_state @ self._covariance).T
            last, self._mean = self._mean, before + gain @ off
            self.camera_turn = turn @ rotation_from_vector(self._mean[CAMERA])
            if np.abs(self._mean - last).max() < CONVERGED:
                break
        covariance = self._covariance - gain @ (by_state @ self._covariance)
        if not np.isfinite(self._mean.sum() + covariance.sum()):
            log.warning("an image is ignored: its tags do not determine a finite state")
            self._mean, self.camera_turn = before, turn
            return
        self._covariance = (covariance + covariance.T) / 2
        self.latency += float(self._mean[LATENCY])
        self._mean[CAMERA] = self._mean[LATENCY] = 0.0

    def _landmark_row(self, tag: int) -> int:
        """Return the first state of a tag's landmark, which is added when it is first seen."""
        name, _ = self._sheets[tag]
        if name not in self._rows:
            n = self._rows[name] = len(self._mean)
            self._mean = np.append(self._mean, np.zeros(LANDMARK))
            covariance = np.diag(np.append(np.zeros(n), self._landmark))
            covariance[:n, :n] = self._covariance
            self._covariance = covariance
        return self._rows[name]

    def _residuals(
        self, views: Sequence[tuple[int, View]], landmarks: Sequence[int], track: OdometryTrack
    ) -> tuple[Array, ...]:
        """Return the (M,) residuals of all rays, and their derivatives by state and time."""
        sample, mean = track.at(self._time), self._mean
        lean = TILT_PER_SLIP * mean[[SLIP_Y, SLIP_X]] * [1.0, -1.0]
        level = rotation_from_vector(np.array([mean[ROLL] + lean[0], mean[PITCH] + lean[1], 0.0]))
        level = level @ level_rotation(sample.roll, sample.pitch)
        height = self._ground + sample.height + mean[Z]
        position = np.array([mean[X], mean[Y], height])
        ahead = body_velocity(self.anchor, sample)
        velocity = np.array([ahead.real, ahead.imag, sample.velocity[2]]) @ level
        rates = np.array([0.0, 0.0, sample.yaw_rate - self.anchor.yaw_bias]) @ level
        rates[:2] += sample.tilt_rate
        motion = Motion(velocity, rates)
        moving = np.concatenate([rates, velocity])
        body = Pose(rotation_about_z(mean[YAW]) @ level, position)
        camera = Pose(self._mounting.rotation @ self.camera_turn.T, self._mounting.position)
        residuals, derivatives, by_time = [], [], []
        for (tag, view), row in zip(views, landmarks, strict=True):
            _, center = self._sheets[tag]
            away = (view.points - center) @ rotation_from_vector(mean[row : row + 3]).T
            moved = view._replace(points=center + away + mean[row + 3 : row + 6])
            points, residual, by_pose, by_camera = reproject(body, moved, motion, camera)
            rays = points[:, :2] / points[:, 2:]
            by_shift = by_pose[:, 3:] @ body.rotation.T  # of the body in the map
            by_state = np.zeros((len(residual), len(mean)))
            by_state[:, [X, Y, Z]] = by_shift
            by_state[:, [ROLL, PITCH, YAW]] = by_pose[:, :3] @ level.T
            by_state[:, SLIP_X] = -TILT_PER_SLIP * by_state[:, PITCH]
            by_state[:, SLIP_Y] = TILT_PER_SLIP * by_state[:, ROLL]
            by_state[:, CAMERA] = -(by_camera @ skew(points) @ self.camera_turn).reshape(-1, 3)
            by_state[:, row : row + 3] = (by_shift.reshape(-1, 2, 3) @ skew(away)).reshape(-1, 3)
            by_state[:, row + 3 : row + 6] = -by_shift
            by_state *= 1 + mean[FOCAL]
            by_state[:, FOCAL] = rays.ravel()
            residuals.append(residual + mean[FOCAL] * rays.ravel())
            derivatives.append(by_state)
            by_time.append(by_pose @ moving)
        return tuple(map(np.concatenate, (residuals, derivatives, by_time)))


def _weights(views: Sequence[tuple[int, View]], off: Array, spread: Array) -> Array:
    """Return (M,) factors of the variances: above 1 for measurements that are unlikely."""
    factors, first = [], 0
    for _, view in views:
        rows = slice(first, first := first + view.rays.size)
        squared = float(off[rows] @ np.linalg.solve(spread[rows, rows], off[rows]))
        limit = OUTLIER[view.rays.size]
        factors.append(np.full(view.rays.size, max(1.0, squared / limit)))
    return np.concatenate(factors)
