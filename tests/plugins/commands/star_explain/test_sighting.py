"""Targets that agents see in a rehearsal, and agents that safety rules take out of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from star_core import Agent, Camera, Fence, Obstacle, Scene, Tag, World
from star_core.testing import scene as plain_scene
from star_explain.sighting import Lookout

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
CRATE = Obstacle("crate", (((0.1, -0.3), (0.2, -0.3), (0.2, 0.3), (0.1, 0.3)),), (0.0, 0.7))
DOWN = Camera(pitch=math.pi / 2, position=(0.0, 0.0, 0.0), rate=5.0)


def scene(camera: Camera, *obstacles: Obstacle) -> Scene:
    tag = Tag(7, 0.16, (0.0, 0.0, 0.0), UPRIGHT, "red")
    world = World("room", Fence((-9, -9, 0), (9, 9, 9)), obstacles, targets=(tag,))
    agent = Agent("cf1", (0.0, 0.0, 0.0), 0.0, camera=camera)
    return replace(plain_scene(1), agents=(agent,), world=world)


def tags(lookout: Lookout, time: float, *position: float, yaw: float = 0.0) -> list[int]:
    sightings = lookout.look(time, np.array([position]), np.array([yaw]), np.array([True]))
    return [int(tag) for tag in sightings.tag]


@pytest.mark.parametrize(
    ("position", "visible"),
    [
        ((0.0, 0.0, 0.8), True),
        ((0.2, 0.1, 0.8), True),
        ((1.5, 0.0, 0.8), False),  # outside the image
        ((0.0, 0.0, 8.0), False),  # too small in it
        ((0.0, 0.0, -0.8), False),  # from below the floor
    ],
)
def test_targets_are_seen_in_the_image_if_large_enough(
    position: tuple[float, float, float], *, visible: bool
) -> None:
    assert bool(tags(Lookout(scene(DOWN)), 0.0, *position)) is visible


def test_obstacles_hide_targets_behind_them() -> None:
    assert tags(Lookout(scene(DOWN)), 0.0, 0.25, 0.0, 0.8) == [7]
    assert tags(Lookout(scene(DOWN, CRATE)), 0.0, 0.25, 0.0, 0.8) == []
    assert tags(Lookout(scene(DOWN, CRATE)), 0.0, -0.25, 0.0, 0.8) == [7]


def test_targets_are_seen_at_the_rate_of_the_camera() -> None:
    lookout = Lookout(scene(DOWN))
    times = np.arange(0.0, 0.95, 0.1).tolist()
    assert [time for time in times if tags(lookout, time, 0, 0, 0.8)] == pytest.approx(
        [0.0, 0.2, 0.4, 0.6, 0.8]
    )


def test_agents_on_the_ground_see_nothing() -> None:
    lookout = Lookout(scene(DOWN))
    sightings = lookout.look(0.0, np.array([[0.0, 0.0, 0.8]]), np.zeros(1), np.array([False]))
    assert len(sightings.tag) == 0
