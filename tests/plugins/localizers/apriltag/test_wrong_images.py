"""Recovery from images that were accepted although they are wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from star_apriltag.agent_estimator import MIN_IMAGES, CameraReport, FilterEstimator
from star_core import Pose, Tag
from star_core.toolkit import rotation_from_vector
from tests.plugins.localizers.apriltag.conftest import SETTINGS, Circle, sheets, tags_seen

INTERVAL = 0.1  # s, between images
SECONDS = 20.0
DISTANCE = 0.5  # m, between the pose of a wrong image and the true one
GAP = 10.5  # s without an image, after which a landmark is in view
TAGS = sheets(2)


class Flight:
    """An estimator that receives the tags that are seen from given poses."""

    def __init__(self, tags: list[Tag] = TAGS, start: Pose | None = None) -> None:
        self.circle = Circle(SECONDS)
        self.estimator = FilterEstimator(self.circle.agent(), tuple(tags), (), SETTINGS)
        self.tags = tags
        stream = self.circle.odometry(0.0, np.inf)
        self.estimator.add_odometry(stream, np.arange(len(stream.agent)), motors=True)
        if start is not None:
            self.estimator.restart(0.0, start, np.eye(6) * 1e-4)

    def see(self, time: float, body: Pose | None = None, tags: Sequence[Tag] | None = None) -> bool:
        """Add an image of some tags, by default all, from a pose, by default the true one.

        Return whether any is in view.
        """
        body = self.circle.body(time) if body is None else body
        corners = tags_seen(body, self.tags if tags is None else tags)
        numbers, pixels = np.array(list(corners)), np.array(list(corners.values()))
        if corners:
            self.estimator.add_image(CameraReport(0, time, None, numbers, pixels))
        self.estimator.advance(time + SETTINGS.latency)
        return bool(corners)

    def error(self, time: float) -> float:
        """Distance of the estimate from the true position, m."""
        return math.dist(self.estimator.at(time).position, self.circle.body(time).position)


def displaced(body: Pose) -> Pose:
    return Pose(body.rotation, body.position + body.rotation @ np.array([0.0, DISTANCE, 0.0]))


@pytest.mark.parametrize("images", [1, 5])
def test_correct_images_after_wrong_ones_are_accepted(images: int) -> None:
    flight, time = Flight(), GAP
    for _ in range(images):
        body = displaced(flight.circle.body(time))
        flight.see(time, body)
        time += INTERVAL
    assert flight.error(time) > 0.8 * DISTANCE
    for _ in range(MIN_IMAGES):
        assert flight.see(time)
        time += INTERVAL
    assert flight.error(time) < 0.05


def test_a_jump_that_two_landmarks_confirm_is_kept() -> None:
    flight, time = Flight(sheets(8)), GAP
    for _ in range(20):
        flight.see(time, displaced(flight.circle.body(time)))
        time += INTERVAL
    in_view = tags_seen(flight.circle.body(time + 2 * MIN_IMAGES * INTERVAL), flight.tags)
    landmark = next(tag.of for tag in flight.tags if tag.id in in_view)
    for _ in range(2 * MIN_IMAGES):
        flight.see(time, tags=[tag for tag in flight.tags if tag.of == landmark])
        time += INTERVAL
    assert flight.error(time) > 0.8 * DISTANCE


def test_floor_odometry_does_not_prevent_relocation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FilterEstimator, "_measure_floor", lambda *_args, **_options: True)
    away = Pose(rotation_from_vector(np.array([0.0, 0.0, 1.6])), np.array([3.0, 2.0, 0.8]))
    flight = Flight(sheets(8), away)
    for k in range(1, 60):
        flight.see(INTERVAL * k)
    assert flight.error(INTERVAL * 60) < 0.05
