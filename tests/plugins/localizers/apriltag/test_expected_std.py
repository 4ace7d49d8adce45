"""Standard deviations to expect of `apriltag` along paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from star_apriltag.dead_reckoning import START_STD
from star_apriltag.expected_std import SEEN_STD, expected_std
from star_core import Array, Camera, Obstacle, Scene, Tag
from star_core.testing import scene
from star_core.toolkit import CameraModel, square_corners
from star_sim.camera_sim.camera_pose import Shot
from star_sim.camera_sim.geometric import OnboardDetector

FLAT = (0.0, 0.0, 0.0, 1.0)


def room(*tags: tuple[float, float]) -> Scene:
    """One drone with a camera, and tags on the floor."""
    base = scene(1)
    landmarks = tuple(Tag(i, 0.168, (*at, 0.0), FLAT, f"l{i}") for i, at in enumerate(tags))
    agents = (replace(base.agents[0], camera=Camera()),)
    return replace(base, agents=agents, world=replace(base.world, landmarks=landmarks))


def std(
    room: Scene, x: Array, yaw: Array | float = 0.0, tags: int = 2, height: float = 0.8
) -> Array:
    """Return the deviations along positions on the x axis, one each half second, m."""
    n = len(x)
    position = np.stack([x, np.zeros(n), np.full(n, height)], axis=1)[:, None]
    deviations = expected_std(
        room,
        np.arange(0.0, n / 2, 0.5),
        position,
        np.broadcast_to(yaw, n)[:, None],
        max_tags_per_landmark=tags,
    )
    return deviations[:, 0]


def test_a_tag_in_the_image_keeps_the_position_known() -> None:
    assert std(room((0.8, 0.0)), np.zeros(20)) == pytest.approx(SEEN_STD)


def test_what_is_behind_below_or_not_used_is_not_seen() -> None:
    still = np.zeros(20)
    assert std(room((0.8, 0.0)), still, yaw=np.pi)[-1] > 0.1
    assert std(room((-0.1, 0.0)), still)[-1] > 0.1
    assert std(room((3.0, 0.0)), still)[-1] > 0.1  # too small in the image
    assert std(room((0.8, 0.0)), still, tags=0)[-1] > 0.1


@pytest.mark.parametrize("size", [0.12, 0.168])
def test_tags_are_seen_where_the_simulated_camera_detects_them(size: float) -> None:
    outcomes, at_the_edge = set(), 0
    for ahead in np.arange(0.2, 2.4, 0.1):  # ever more slanted
        tag = Tag(0, size, (ahead, 0.3, 0.0), FLAT, "l0")
        tagged = room()
        world = replace(tagged.world, landmarks=(tag,))
        tagged = replace(tagged, world=world, detects_tags=True)
        hovering = Shot(np.array([0.0, 0.0, 0.8]), np.array(FLAT), np.zeros(3), np.zeros(3))
        numbers, _ = OnboardDetector(Camera(), (tag,), tagged.world).detect(hovering)
        outcomes.add(detected := len(numbers) == 1)
        visible = std(tagged, np.zeros(20))[-1] == pytest.approx(SEEN_STD)
        assert detected or not visible, ahead
        at_the_edge += detected and not visible
    assert outcomes == {False, True}
    assert at_the_edge <= 1


def test_tags_at_the_edge_of_the_image_do_not_count_as_seen() -> None:
    model = CameraModel(Camera())
    corner = np.array(square_corners(0.168))
    edges = {}
    for ahead in np.arange(0.2, 0.6, 0.01):
        body = model.mounting.rotation
        eye = np.array([0.0, 0.0, 0.8]) + model.mounting.position
        points = (corner + np.array([ahead, 0.0, 0.0]) - eye) @ body
        pixels = model.project(points)
        edge = min(pixels.min(), (np.array([323.0, 243.0]) - pixels).min())
        edges[ahead] = edge, std(room((ahead, 0.0)), np.zeros(20))[-1]
    near = [deviation for edge, deviation in edges.values() if 3.0 < edge < 8.0]
    inside = [deviation for edge, deviation in edges.values() if edge > 8.0]
    assert near
    assert min(near) > 2 * SEEN_STD
    assert inside == pytest.approx([SEEN_STD] * len(inside))


def test_images_show_tags_at_slants_that_detectors_on_board_do_not_read() -> None:
    far = room((1.4, 0.3))
    assert std(far, np.zeros(20))[-1] == pytest.approx(SEEN_STD)
    assert std(replace(far, detects_tags=True), np.zeros(20))[-1] > 2 * SEEN_STD


def test_errors_grow_between_landmarks_and_vanish_at_the_next() -> None:
    deviations = std(room((0.8, 0.0), (4.6, 0.0)), np.linspace(0.0, 4.0, 20))
    gap = deviations > SEEN_STD
    assert gap.any()
    assert deviations[0] == deviations[-1] == SEEN_STD
    assert (np.diff(deviations[gap]) > 0).all()
    assert 0.1 < deviations.max() < 0.3


def test_an_uncertain_drone_may_pass_a_tag_without_seeing_it() -> None:
    near, far = np.zeros(20), np.full(40, -4.0)  # far from the tag, it sees none
    edge = room((0.8, 0.8))  # in the image, near its border
    assert std(edge, near)[-1] == pytest.approx(SEEN_STD)
    assert std(edge, np.append(far, near))[-1] > 0.2
    assert std(room((0.8, 0.0)), np.append(far, near))[-1] == pytest.approx(SEEN_STD)


def test_an_uncertain_drone_that_turns_to_a_tag_sees_it() -> None:
    yaw = np.repeat([np.pi, 0.0], [60, 20])
    assert std(room((0.8, 0.0)), np.zeros(80), yaw)[59] > 0.2
    assert std(room((0.8, 0.0)), np.zeros(80), yaw)[-1] == pytest.approx(SEEN_STD)


def test_a_drone_that_stands_does_not_drift() -> None:
    assert std(room(), np.zeros(60), height=0.0)[[0, -1]] == pytest.approx(START_STD)


@pytest.mark.parametrize(("height", "rms"), [(0.5, 0.234), (0.75, 0.272), (1.3, 0.373)])
def test_blind_hovers_drift_as_in_the_default_world(height: float, rms: float) -> None:
    still = std(room(), np.zeros(61), height=height)
    grown = still[-1] ** 2 - still[0] ** 2
    assert np.sqrt(grown) == pytest.approx(rms, rel=0.15)  # of 72 drones, over 30 s, each axis


def test_obstacles_hide_tags() -> None:
    tagged, still = room((0.8, 0.0)), np.zeros(20)
    wall = ((0.4, -0.5), (0.5, -0.5), (0.5, 0.5), (0.4, 0.5))
    for top, hidden in ((2.0, True), (0.1, False)):
        world = replace(tagged.world, obstacles=(Obstacle("wall", (wall,), (0.0, top)),))
        assert (std(replace(tagged, world=world), still)[-1] > 0.1) == hidden
