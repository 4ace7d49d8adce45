"""Targets: found once, by one agent, at the mean of what was seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from star_core import Fence, Sightings, Tag, World
from star_core.targets import MIN_SIGHTINGS, Targets
from star_core.testing import scene

LEVEL = (0.0, 0.0, 0.0, 1.0)
TAGS = (
    Tag(40, 0.1, (1.0, 0.0, 0.0), LEVEL, "bag"),
    Tag(41, 0.1, (1.0, 1.0, 0.0), LEVEL, "bag"),
    Tag(50, 0.1, (3.0, 0.0, 0.0), LEVEL, "cat"),
)


def targets() -> Targets:
    world = World("room", Fence((-9, -9, 0), (9, 9, 3)), targets=TAGS)
    return Targets(replace(scene(2), world=world))


def sighting(agent: int, tag: int, off: float = 0.0, deviation: float = 0.1) -> Sightings:
    """A tag seen `off` m beside its place along x."""
    place = next((np.array(t.position) for t in TAGS if t.id == tag), np.zeros(3))
    return Sightings(
        agent=np.array([agent]),
        tag=np.array([tag]),
        time=np.zeros(1),
        position=place[None] + np.array([off, 0, 0]),
        yaw=np.zeros(1),
        covariance=np.array([deviation**2 * np.eye(3)]),
    )


def test_a_target_is_found_once_by_the_agent_that_is_sure_first() -> None:
    register = targets()
    new = []
    for k in range(MIN_SIGHTINGS):
        new += register.add(sighting(0, 40), k)
        new += register.add(sighting(1, 40), k)
    assert new == [("bag", "cf1")]
    assert register.finder.tolist() == [0, -1]
    (target,) = register.summary()["list"]
    assert (target["name"], target["finder"], target["time_s"]) == ("bag", "cf1", MIN_SIGHTINGS - 1)


def test_one_image_is_not_enough() -> None:
    register = targets()
    assert [register.add(sighting(0, 50), k) for k in range(MIN_SIGHTINGS)] == [[]] * (
        MIN_SIGHTINGS - 1
    ) + [[("cat", "cf1")]]


def test_target_positions_are_variance_weighted_means() -> None:
    register = targets()
    for k in range(MIN_SIGHTINGS):
        register.add(sighting(0, 40, 0.3, deviation=0.2), k)
        register.add(sighting(1, 41, -0.1, deviation=0.1), k)
    (target,) = register.summary()["list"]
    off = (0.3 / 4 - 0.1) / (1 / 4 + 1)  # weighed by 1 / variance
    assert target["position_m"] == pytest.approx([1.0 + off, 0.0, 0.0])
    assert target["error_m"] == pytest.approx(abs(off))


@pytest.mark.parametrize("tag", [7, 40], ids=["no target", "nowhere"])
def test_what_is_no_target_or_nowhere_is_passed_over(tag: int) -> None:
    register = targets()
    for k in range(MIN_SIGHTINGS):
        assert register.add(sighting(0, tag, deviation=np.nan if tag == 40 else 0.1), k) == []
    assert register.summary() == {"found": 0, "total": 2, "list": []}
