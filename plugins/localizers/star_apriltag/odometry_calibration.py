"""Calibration of one agent's odometry in flight, from pairs of well-known poses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from star_apriltag.odometry_track import OdometryTrack
from star_core import wrap_angle

MAX_POSITION_STD: Final = 0.04  # m, in x and in y, of a pose that is used
MIN_TIME, MIN_LENGTH = 1.0, 0.25  # s and m between the two poses of a pair
MIN_YAW_TIME: Final = 4.0  # s between two headings, without the time at rest
MAX_TIME: Final = 40.0  # s between the two poses of a pair
GATE: Final = 3.0  # standard deviations of an accepted measurement

SCALE_STD: Final = 0.08  # initial, of each component
BIAS_STD: Final = math.radians(0.25)  # rad/s, initial
FLOOR = 0.05**2 * 0.7  # m²/m: 5 % error of scale with the floor, correlated over 0.7 m
NOISE = 0.012**2  # m²/s, of the flow sensor
SEEN_FLOOR, SEEN_NOISE = 0.006**2, 0.002**2  # m²/m and m²/s, of motion measured by images
YAW_NOISE = math.radians(0.1) ** 2  # rad²/s, of the gyro


@dataclass(frozen=True, slots=True)
class KnownPose:
    """Pose of the agent at one time, from tags."""

    time: float  # s
    position: complex  # x + iy in the map, m
    yaw: float  # rad
    deviation: float  # standard deviation of x and of y, m
    yaw_deviation: float  # rad


class OdometryCalibration:
    """A Kalman filter for the scale, the misalignment and the yaw bias of one agent's odometry.

    Attributes:
        scale: ``(1 + s) exp(i m)``: factor of the odometry's displacements.
        yaw_bias: rad/s, to be subtracted from its yaw rate.
    """

    def __init__(self) -> None:
        self.scale: complex = 1.0 + 0j
        self.yaw_bias = 0.0
        self._scale_variance = SCALE_STD**2
        self._bias_variance = BIAS_STD**2
        self._pose: KnownPose | None = None
        self._heading: KnownPose | None = None

    def forget_poses(self) -> None:
        """Begin new pairs: the poses so far were wrong."""
        self._pose = self._heading = None

    def add(self, pose: KnownPose, track: OdometryTrack) -> None:
        """Add a pose of the agent, in the order of time."""
        if pose.deviation <= MAX_POSITION_STD:
            self._heading = self._update_bias(self._heading, pose, track)
            self._pose = self._update_scale(self._pose, pose, track)

    def _update_bias(
        self, old: KnownPose | None, new: KnownPose, track: OdometryTrack
    ) -> KnownPose:
        """Return the first pose of the next pair."""
        if old is None or new.time - old.time > MAX_TIME:
            return new
        motion = track.between(old.time, new.time)
        duration = motion.duration
        if duration < MIN_YAW_TIME:
            return old
        excess = wrap_angle(motion.turn - (new.yaw - old.yaw)) / duration
        noise = old.yaw_deviation**2 + new.yaw_deviation**2 + YAW_NOISE * duration
        gain, shrink = _gain(self._bias_variance, noise / duration**2, abs(excess - self.yaw_bias))
        self.yaw_bias += gain * (excess - self.yaw_bias)
        self._bias_variance *= shrink
        return new

    def _update_scale(
        self, old: KnownPose | None, new: KnownPose, track: OdometryTrack
    ) -> KnownPose:
        """Return the first pose of the next pair."""
        if old is None or new.time - old.time > MAX_TIME:
            return new
        motion = track.between(old.time, new.time, yaw_bias=self.yaw_bias)
        length = abs(motion.shift)
        if motion.duration < MIN_TIME or length < MIN_LENGTH:
            return old
        heading = complex(math.cos(old.yaw), math.sin(old.yaw))
        ratio = (new.position - old.position) / (heading * motion.shift)
        turn = math.hypot(old.yaw_deviation, math.sqrt(self._bias_variance) * motion.duration / 2)
        noise = (
            old.deviation**2
            + new.deviation**2
            + (turn * length) ** 2
            + FLOOR * motion.blind_length
            + NOISE * motion.blind_duration
            + SEEN_FLOOR * (motion.length - motion.blind_length)
            + SEEN_NOISE * (motion.duration - motion.blind_duration)
        ) / length**2
        gain, shrink = _gain(self._scale_variance, noise, abs(ratio - self.scale) / math.sqrt(2))
        self.scale += gain * (ratio - self.scale)
        self._scale_variance *= shrink
        return new


def _gain(variance: float, noise: float, off: float) -> tuple[float, float]:
    """Return the Kalman gain and the factor of the variance; 0 and 1 for an outlier."""
    if off**2 > GATE**2 * (variance + noise):
        return 0.0, 1.0
    gain = variance / (variance + noise)
    return gain, 1 - gain
