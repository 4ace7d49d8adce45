"""How wrong one agent's odometry is: learnt in flight from pairs of well-known places."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from star_apriltag.odometry_track import Track
from star_core import wrap_angle

WELL_KNOWN: Final = 0.04  # m, deviation in x and in y up to which a place serves
LEAST_TIME, LEAST_WAY = 1.0, 0.25  # s and m between the two places of a pair
LEAST_YAW_TIME: Final = 4.0  # s between two headings, without what it stood
LONGEST: Final = 40.0  # s between the two places of a pair
GATE: Final = 3.0  # deviations that a measurement may be off

SCALE_DEVIATION: Final = 0.08  # before anything is known, of each component
BIAS_DEVIATION: Final = math.radians(0.25)  # rad/s, before anything is known
FLOOR = 0.05**2 * 0.7  # m²/m: 5 % error of scale with the floor, correlated over 0.7 m
WALK = 0.012**2  # m²/s: the flow sensor's noise
SEEN_FLOOR, SEEN_WALK = 0.006**2, 0.002**2  # m²/m and m²/s, where images measured the way
YAW_WALK = math.radians(0.1) ** 2  # rad²/s: the gyro's noise


@dataclass(frozen=True, slots=True)
class Place:
    """Where the agent was at one time, and how well that is known.

    Attributes:
        time: s.
        position: x + iy in the map, m.
        yaw: rad.
        deviation: Of x and of y, m.
        yaw_deviation: rad.
    """

    time: float
    position: complex
    yaw: float
    deviation: float
    yaw_deviation: float


class Calibration:
    """A Kalman filter over the scale, the misalignment and the yaw bias of one agent's odometry.

    Attributes:
        scale: ``(1 + s) exp(i m)``: multiplies a displacement of the odometry.
        yaw_bias: rad/s, to be taken from its yaw rate.
    """

    def __init__(self) -> None:
        self.scale: complex = 1.0 + 0j
        self.yaw_bias = 0.0
        self._scale_variance = SCALE_DEVIATION**2
        self._bias_variance = BIAS_DEVIATION**2
        self._place: Place | None = None
        self._heading: Place | None = None

    def forget_places(self) -> None:
        """Begin new pairs: what was known of the places no longer holds."""
        self._place = self._heading = None

    def learn(self, place: Place, track: Track) -> None:
        """Take in a place that the agent was at, in the order of time."""
        if place.deviation > WELL_KNOWN:
            return
        self._heading = self._learn_bias(self._heading, place, track)
        self._place = self._learn_scale(self._place, place, track)

    def _learn_bias(self, old: Place | None, new: Place, track: Track) -> Place:
        if old is None or new.time - old.time > LONGEST:
            return new
        motion = track.between(old.time, new.time)
        took = motion.duration
        if took < LEAST_YAW_TIME:
            return old
        excess = wrap_angle(motion.turn - (new.yaw - old.yaw)) / took
        noise = (old.yaw_deviation**2 + new.yaw_deviation**2 + YAW_WALK * took) / took**2
        gain, shrink = _gain(self._bias_variance, noise, abs(excess - self.yaw_bias))
        self.yaw_bias += gain * (excess - self.yaw_bias)
        self._bias_variance *= shrink
        return new

    def _learn_scale(self, old: Place | None, new: Place, track: Track) -> Place:
        if old is None or new.time - old.time > LONGEST:
            return new
        motion = track.between(old.time, new.time, yaw_bias=self.yaw_bias)
        way = abs(motion.shift)
        if motion.duration < LEAST_TIME or way < LEAST_WAY:
            return old
        heading = complex(math.cos(old.yaw), math.sin(old.yaw))
        ratio = (new.position - old.position) / (heading * motion.shift)
        turn = math.hypot(old.yaw_deviation, math.sqrt(self._bias_variance) * motion.duration / 2)
        noise = (
            old.deviation**2
            + new.deviation**2
            + (turn * way) ** 2
            + FLOOR * motion.blind_length
            + WALK * motion.blind_duration
            + SEEN_FLOOR * (motion.length - motion.blind_length)
            + SEEN_WALK * (motion.duration - motion.blind_duration)
        ) / way**2
        gain, shrink = _gain(self._scale_variance, noise, abs(ratio - self.scale) / math.sqrt(2))
        self.scale += gain * (ratio - self.scale)
        self._scale_variance *= shrink
        return new


def _gain(variance: float, noise: float, off: float) -> tuple[float, float]:
    """Return the Kalman gain and what the variance shrinks to, none for a measurement far off."""
    if off**2 > GATE**2 * (variance + noise):
        return 0.0, 1.0
    gain = variance / (variance + noise)
    return gain, 1 - gain
