"""Positions of targets by the localizer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from star_apriltag.localizer import AprilTag
from tests.plugins.localizers.apriltag.conftest import (
    TARGET,
    TICK,
    Circle,
    localizer,
    room,
    sheets,
    ticks,
)

TAGS = sheets()


def sightings(circle: Circle, made: AprilTag) -> list[tuple[float, float, float]]:
    """Of every sighting: how far off, m, how many deviations that is, and its worst deviation."""
    errors = []
    for heard in ticks([circle], circle.time[-1], [*TAGS, TARGET]):
        batch = made.locate(heard).sightings
        for tag, place, covariance in zip(batch.tag, batch.position, batch.covariance, strict=True):
            assert tag == TARGET.id
            error = place - TARGET.position
            worst = math.sqrt(np.linalg.eigvalsh(covariance)[-1])
            surprise = math.sqrt(error @ np.linalg.solve(covariance, error))
            errors.append((float(np.linalg.norm(error)), surprise, worst))
    return errors


@pytest.mark.parametrize("seed", [None, 1, 2])
def test_a_target_is_seen_where_it_is_within_three_deviations(seed: int | None) -> None:
    circle = Circle(3, seed=seed)
    errors = np.array(sightings(circle, localizer(room([circle], TAGS))))
    assert len(errors) > 5
    assert errors[:, 1].max() < 3.0
    assert errors[:, 2].max() < 0.15
    assert errors[:, 2].min() > 0.002


def test_sightings_by_lost_agents_are_as_uncertain_as_the_agent() -> None:
    circle = Circle(3)
    blind = np.array(sightings(circle, localizer(room([circle], []))))
    sure = np.array(sightings(circle, localizer(room([circle], TAGS))))
    assert np.median(blind[:, 2]) > 1.5 * np.median(sure[:, 2])


def test_a_sighting_has_the_time_and_the_heading_of_its_tag() -> None:
    circle = Circle(3)
    made, count = localizer(room([circle], TAGS)), 0
    for heard in ticks([circle], 3.0, [*TAGS, TARGET]):
        batch = made.locate(heard).sightings
        for time, yaw in zip(batch.time, batch.yaw, strict=True):
            assert time == pytest.approx(heard.time - TICK - 0.15)  # it is known a tick later
            assert math.remainder(yaw - 0.4, math.tau) == pytest.approx(0.0, abs=0.05)
            count += 1
    assert count > 5
