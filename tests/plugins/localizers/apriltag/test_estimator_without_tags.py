"""An agent that is followed by its images where no tag is in sight."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np

from star_apriltag.agent_estimator import CameraReport, FilterEstimator
from star_core import Agent, Array, Camera, Odometry, Tag
from tests.plugins.localizers.apriltag.conftest import SETTINGS
from tests.plugins.localizers.apriltag.test_floor_odometry import HEIGHT, picture

SPEED, REPORTED = 0.3, 0.36  # m/s: true, and by odometry
SECONDS: Final = 3.0
NO_CORNERS = np.zeros((0, 4, 2))
NOWHERE = Tag(7, 0.168, (50.0, 50.0, 0.0), (0.0, 0.0, 0.0, 1.0), "far away")


@cache
def followed(*, floor: bool = True, stains: float = 1.0) -> FilterEstimator:
    """An agent after a straight flight along x over a floor without tags."""
    agent = Agent("cf1", (0.0, 0.0, HEIGHT), camera=Camera(readout=0.0))
    follower = FilterEstimator(agent, (NOWHERE,), (), SETTINGS._replace(floor_odometry=floor))
    for k in range(1, round(10 * SECONDS) + 1):
        follower.add_odometry(
            odometry(0.1 * k + np.arange(-9, 1) / 100), np.arange(10), motors=True
        )
        image = picture(SPEED * 0.1 * k + 0j, stains=stains, key=k)
        follower.add_image(CameraReport(0, 0.1 * k, image, np.zeros(0, np.int64), NO_CORNERS))
        follower.advance(0.1 * k)
    return follower


def odometry(time: Array) -> Odometry:
    n, zero = len(time), np.zeros(len(time))
    velocity = np.tile([REPORTED, 0.0, 0.0], (n, 1))
    return Odometry(zero.astype(int), time, velocity, zero, zero, zero, zero)


def test_the_floor_measures_the_distance_though_odometry_errs() -> None:
    x, y, _ = followed().at(SECONDS).position
    assert abs(x - SPEED * SECONDS) < 0.2 * (REPORTED - SPEED) * SECONDS
    assert abs(y) < 0.01


def test_without_texture_odometry_is_all_there_is() -> None:
    for follower in (followed(stains=0.0), followed(floor=False)):
        x, _, _ = follower.at(SECONDS).position
        assert abs(x - REPORTED * SECONDS) < 0.01


def test_each_measured_image_is_a_pose_for_others_to_go_on_from() -> None:
    assert followed().anchor.time == SECONDS
    assert followed(floor=False).anchor.time < SECONDS - 0.3


def test_a_measured_way_is_surer_than_a_blind_one() -> None:
    measured, blind = (followed(floor=floor).at(SECONDS) for floor in (True, False))
    gained, lost = (
        belief.covariance[0, 0] - 0.05**2
        for belief in (measured, blind)  # where it started
    )
    assert 0 < gained < 0.5 * lost
