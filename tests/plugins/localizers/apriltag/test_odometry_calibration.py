"""What is learnt of an agent's odometry from pairs of well-known places."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from star_apriltag.odometry_track import (
    MAX_POSITION_STD,
    KnownPose,
    OdometryCalibration,
    OdometryTrack,
)
from tests.plugins.localizers.apriltag.conftest import SPEED, Circle

SCALE, BIAS = cmath.rect(1.06, math.radians(2.0)), math.radians(0.3)


def odometry(circle: Circle) -> OdometryTrack:
    track = OdometryTrack()
    stream = circle.odometry(0.0, np.inf)
    track.add(stream, np.arange(len(stream.agent)))
    return track


def place(circle: Circle, time: float, deviation: float = 0.01, aside: complex = 0j) -> KnownPose:
    """Where it really was, or aside of that."""
    body = circle.body(time)
    there = complex(body.position[0], body.position[1]) + aside
    return KnownPose(time, there, body.yaw, deviation, math.radians(0.5))


def learnt(circle: Circle, seconds: float = 60.0, **how: float) -> OdometryCalibration:
    calibration, track = OdometryCalibration(), odometry(circle)
    for time in np.arange(0.1, seconds, 0.1):
        calibration.add(place(circle, float(time), **how), track)
    return calibration


def test_it_finds_scale_and_misalignment() -> None:
    assert abs(learnt(Circle(60, scale=SCALE)).scale - SCALE) < 0.01


def test_it_finds_the_yaw_bias() -> None:
    assert learnt(Circle(60, yaw_bias=BIAS)).yaw_bias == pytest.approx(BIAS, abs=0.1 * BIAS)


def test_it_finds_both_at_once() -> None:
    both = learnt(Circle(60, scale=SCALE, yaw_bias=BIAS))
    assert abs(both.scale - SCALE) < 0.01
    assert both.yaw_bias == pytest.approx(BIAS, abs=0.1 * BIAS)


def test_correct_odometry_is_not_changed() -> None:
    right = learnt(Circle(60))
    assert abs(right.scale - 1) < 1e-4
    assert abs(right.yaw_bias) < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_it_does_better_than_none_though_odometry_is_noisy(seed: int) -> None:
    circle = Circle(60, seed=seed)
    raw = complex(np.mean(circle.velocity)) / SPEED  # reported over true
    assert abs(learnt(circle).scale * raw - 1) < max(0.5 * abs(raw - 1), 0.02)


def test_a_pose_beyond_the_gate_changes_nothing() -> None:
    circle = Circle(80, scale=SCALE)
    calibration = learnt(circle)
    before = calibration.scale
    calibration.add(place(circle, 62.0, aside=1.0 + 0j), odometry(circle))
    assert calibration.scale == before


def test_an_uncertain_pose_changes_nothing() -> None:
    ignorant = learnt(Circle(60, scale=SCALE, yaw_bias=BIAS), deviation=1.01 * MAX_POSITION_STD)
    assert (ignorant.scale, ignorant.yaw_bias) == (1.0, 0.0)


def test_places_that_were_forgotten_make_no_pair() -> None:
    circle = Circle(10, scale=SCALE, yaw_bias=BIAS)
    calibration, track = OdometryCalibration(), odometry(circle)
    calibration.add(place(circle, 0.1), track)
    calibration.forget_poses()
    calibration.add(place(circle, 6.0), track)
    assert (calibration.scale, calibration.yaw_bias) == (1.0, 0.0)


def test_what_was_learnt_outlives_the_places() -> None:
    calibration = learnt(Circle(60, scale=SCALE))
    before = calibration.scale
    calibration.forget_poses()
    assert calibration.scale == before


def test_places_too_long_apart_make_no_pair() -> None:
    circle = Circle(60, scale=SCALE, yaw_bias=BIAS)
    calibration, track = OdometryCalibration(), odometry(circle)
    calibration.add(place(circle, 0.1), track)
    calibration.add(place(circle, 50.0), track)
    assert (calibration.scale, calibration.yaw_bias) == (1.0, 0.0)


def test_an_agent_that_stands_still_tells_nothing_of_the_scale() -> None:
    circle = Circle(20, scale=SCALE)
    circle.velocity[:] = 0.0
    standing, track = OdometryCalibration(), odometry(circle)
    for time in np.arange(0.1, 20, 0.1):
        standing.add(KnownPose(float(time), 0j, 0.28 * time, 0.01, 0.01), track)
    assert standing.scale == 1.0


def test_a_heading_that_passes_half_a_turn_is_no_outlier() -> None:
    circle = Circle(8, yaw_bias=BIAS)
    track, calibration = odometry(circle), OdometryCalibration()
    first, second = place(circle, 3.0), place(circle, 7.5)
    assert second.yaw < first.yaw  # it wraps in between
    calibration.add(first, track)
    calibration.add(second, track)
    assert calibration.yaw_bias > 0.5 * BIAS


def test_it_is_surer_of_the_scale_where_images_measured_the_way() -> None:
    circle = Circle(60, scale=SCALE)
    seen, blind = odometry(circle), odometry(circle)
    for begin in np.arange(0.0, 59.0, 0.5):
        motion = seen.between(float(begin), float(begin) + 0.5)
        seen.correct(float(begin), float(begin) + 0.5, motion.shift, yaw_bias=0.0)
    off = []
    for track in (seen, blind):
        calibration = OdometryCalibration()
        for time in (1.0, 6.0):
            calibration.add(place(circle, time), track)
        off.append(abs(calibration.scale - SCALE))
    assert off[0] < 0.5 * off[1]
