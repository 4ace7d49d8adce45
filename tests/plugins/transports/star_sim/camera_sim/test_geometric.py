"""What is found without a picture."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Camera, Obstacle, Tag
from star_core.world.quaternions import turned
from star_sim.camera_sim.geometric import OnboardDetector
from tests.plugins.transports.star_sim.camera_sim.conftest import room, take

CAMERA = Camera()


def lying(number: int, x: float, y: float = 0.0, yaw: float = 0.0, size: float = 0.168) -> Tag:
    return Tag(number, size, (x, y, 0.0), turned(0, 0, yaw), f"sheet{number}")


def pillar(height: float, foot: float = 0.0) -> Obstacle:
    return Obstacle(
        "pillar", (((0.5, -0.1), (0.55, -0.1), (0.55, 0.1), (0.5, 0.1)),), (foot, height)
    )


def test_corners_run_from_the_lower_left_against_the_clock() -> None:
    ids, corners = OnboardDetector(CAMERA, [lying(5, 0.0, 0.8)], room()).detect(
        take(turn=(0, 0, np.pi / 2))
    )
    lower_left, lower_right, upper_right, upper_left = corners[0]
    assert list(ids) == [5]
    assert lower_left[0] < lower_right[0]
    assert lower_right[1] > upper_right[1]
    assert upper_right[0] > upper_left[0]


def test_only_tags_wholly_in_the_image_are_found() -> None:
    tags = [lying(0, 0.8), lying(1, 0.8, 1.1), lying(2, 0.2), lying(3, -0.8)]
    assert list(OnboardDetector(CAMERA, tags, room()).detect(take())[0]) == [0]


def test_far_and_small_tags_are_not_found() -> None:
    tags = [
        lying(0, 1.0),
        lying(1, 2.5),
        lying(2, 1.0, 0.3, size=0.05),
        lying(3, 2.5, 0.8, size=0.6),
    ]
    assert list(OnboardDetector(CAMERA, tags, room()).detect(take())[0]) == [0, 3]


def test_the_back_of_a_tag_is_not_found() -> None:
    tags = [
        Tag(0, 0.168, (1.0, 0.2, 0.4), turned(np.pi / 2, 0, -np.pi / 2), "faces the camera"),
        Tag(1, 0.168, (1.0, -0.2, 0.4), turned(np.pi / 2, 0, np.pi / 2), "faces away"),
    ]
    assert list(OnboardDetector(CAMERA, tags, room()).detect(take())[0]) == [0]


@pytest.mark.parametrize(
    ("obstacle", "tags"),
    [(pillar(0.6), []), (pillar(0.1), [0]), (pillar(2.0, foot=0.6), [0]), (pillar(2.0, 0.2), [])],
)
def test_an_obstacle_hides_the_tags_in_its_shadow(obstacle: Obstacle, tags: list[int]) -> None:
    assert list(OnboardDetector(CAMERA, [lying(0, 0.8)], room(obstacle)).detect(take())[0]) == tags


def test_a_tag_on_the_face_or_the_top_of_an_obstacle_is_found() -> None:
    box = Obstacle("box", (((0.7, -0.5), (1.2, -0.5), (1.2, 0.5), (0.7, 0.5)),), (0.0, 0.3))
    tags = [
        Tag(0, 0.15, (0.7, 0.0, 0.15), turned(np.pi / 2, 0, -np.pi / 2), "face"),
        Tag(1, 0.15, (0.85, 0.0, 0.3), turned(0, 0, 0), "top"),
    ]
    assert list(OnboardDetector(CAMERA, tags, room(box)).detect(take())[0]) == [0, 1]


def test_noise_moves_each_corner_by_its_deviation() -> None:
    tags = [lying(i, 0.6 + 0.25 * (i % 3), 0.25 * (i // 3) - 0.25) for i in range(9)]
    detector = OnboardDetector(CAMERA, tags, room(), noise=0.5)
    rng = np.random.default_rng(0)
    _, exact = detector.detect(take())
    errors = [detector.detect(take(), rng)[1] - exact for _ in range(50)]
    assert np.std(errors) == pytest.approx(0.5, rel=0.05)
    assert np.mean(errors) == pytest.approx(0.0, abs=0.05)
    again = detector.detect(take(), np.random.default_rng(0))[1] - exact
    assert (again == errors[0]).all()


def test_a_world_without_tags_gives_empty_tables() -> None:
    ids, corners = OnboardDetector(CAMERA, [], room()).detect(take(), np.random.default_rng(0))
    assert ids.shape == (0,)
    assert corners.shape == (0, 4, 2)
