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
    found = []
    for heard in ticks([circle], circle.time[-1], [*TAGS, TARGET]):
        seen = made.locate(heard).sightings
        for tag, place, covariance in zip(seen.tag, seen.position, seen.covariance, strict=True):
            assert tag == TARGET.id
            error = place - TARGET.position
            worst = math.sqrt(np.linalg.eigvalsh(covariance)[-1])
            surprise = math.sqrt(error @ np.linalg.solve(covariance, error))
            found.append((float(np.linalg.norm(error)), surprise, worst))
    return found


@pytest.mark.parametrize("seed", [None, 1, 2])
def test_a_target_is_seen_where_it_is_within_three_deviations(seed: int | None) -> None:
    circle = Circle(3, seed=seed)
    found = np.array(sightings(circle, localizer(room([circle], TAGS))))
    assert len(found) > 5
    assert found[:, 1].max() < 3.0
    assert found[:, 2].max() < 0.15
    assert found[:, 2].min() > 0.002


def test_sightings_by_lost_agents_are_as_uncertain_as_the_agent() -> None:
    circle = Circle(3)
    blind = np.array(sightings(circle, localizer(room([circle], []))))
    sure = np.array(sightings(circle, localizer(room([circle], TAGS))))
    assert np.median(blind[:, 2]) > 1.5 * np.median(sure[:, 2])


def test_a_sighting_has_the_time_and_the_heading_of_its_tag() -> None:
    circle = Circle(3)
    made, seen = localizer(room([circle], TAGS)), 0
    for heard in ticks([circle], 3.0, [*TAGS, TARGET]):
        found = made.locate(heard).sightings
        for time, yaw in zip(found.time, found.yaw, strict=True):
            assert time == pytest.approx(heard.time - TICK - 0.15)  # it is known a tick later
            assert math.remainder(yaw - 0.4, math.tau) == pytest.approx(0.0, abs=0.05)
            seen += 1
    assert seen > 5
