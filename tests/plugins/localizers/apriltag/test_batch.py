"""The original's algorithm, which is there to compare with."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from star_apriltag.batch import BatchEstimator
from star_apriltag.localizer import camera_reports
from star_core import Frames
from tests.plugins.localizers.apriltag.conftest import (
    Circle,
    blank,
    flight,
    localizer,
    off,
    room,
    sheets,
    telemetry,
    ticks,
)

TAGS = sheets()


def test_tags_correct_the_drift_of_odometry() -> None:
    circle = Circle(14, seed=3)
    alone = flight(circle, method="batch")
    seeing = flight(circle, TAGS, method="batch")
    assert off(seeing, circle)[200:].max() < 0.5 * off(alone, circle)[200:].max()


def test_images_are_poses_in_the_graph_at_their_arrival() -> None:
    circle = Circle(10)
    follower = BatchEstimator(circle.agent(), tuple(TAGS))
    arrivals = set()
    for heard in ticks([circle], 5.0, TAGS):
        follower.add_odometry(heard.odometry, np.arange(len(heard.odometry.agent)), motors=True)
        for sight in camera_reports(heard, 0.15):
            follower.add_image(sight)
            arrivals.add(sight.arrived)
    assert 20 <= follower._count <= 31  # at 6 Hz at most
    assert follower.anchor.time in arrivals


def test_an_image_of_another_size_is_excluded(caplog: pytest.LogCaptureFixture) -> None:
    circle = Circle(10)
    made = localizer(room([circle], TAGS), method="batch")
    zero = np.zeros(1)
    image = Frames(np.zeros(1, np.int64), zero + 0.9, zero + 1.0, (blank(height=10),))
    with caplog.at_level(logging.WARNING):
        estimate = made.locate(replace(telemetry([circle], 1.0), frames=image))
    assert estimate.valid.all()
    assert "an image of cf0 is ignored" in caplog.text
