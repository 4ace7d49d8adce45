"""Which tags should be seen, and where."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from star_apriltag.vision.body_pose import HEIGHT_STD, Motion, Prediction
from star_apriltag.vision.expected_tags import MAX_TAGS, TURN_STD, ExpectedTag, ExpectedTags
from star_apriltag.vision.tag_poses import MapTag
from star_core import Array, Pose, Tag
from star_core.toolkit import rotation_from_vector
from tests.plugins.localizers.vision.conftest import LENS, hovering, on_floor, on_wall, predicted

BODY = hovering(yaw=0.2, pitch=0.02)
TAG = on_floor(1, 1.3, 0.3)


def expect(
    tags: Sequence[Tag],
    prediction: Prediction | None = None,
    exclude: Sequence[int] = (),
) -> list[ExpectedTag]:
    places = [MapTag(tag) for tag in tags]
    return ExpectedTags(LENS, places).expect(prediction or predicted(BODY), exclude)


def centre(body: Pose, tag: Tag) -> Array:
    ahead = (body @ LENS.mounting).inverse().apply(np.array(tag.position))
    pixel: Array = LENS.project(ahead[None])[0]
    return pixel


def test_a_tag_is_expected_where_it_is() -> None:
    (expected,) = expect([TAG])
    np.testing.assert_allclose(expected.pixel, centre(BODY, TAG), atol=1e-9)
    eye = (BODY @ LENS.mounting).position
    assert expected.distance == pytest.approx(math.dist(eye, TAG.position))


def test_rolling_shutter_motion_shifts_expected_tags() -> None:
    motion = Motion(np.array([0.5, 0.2, 0.0]), np.array([0.0, 0.0, 0.9]))
    moving = replace(predicted(BODY), motion=motion)
    far = on_floor(1, 2.1, 0.5)
    (expected,) = expect([far], moving)
    step = np.concatenate([motion.rates, motion.velocity])
    late = BODY.moved(float(LENS.row_delay(expected.pixel)) * step)
    np.testing.assert_allclose(expected.pixel, centre(late, far), atol=0.02)
    assert np.abs(expected.pixel - centre(BODY, far)).max() > 0.5


def test_camera_mounting_rotation_shifts_expected_tags() -> None:
    extra = rotation_from_vector(np.radians([1.0, -2.0, 0.5]))
    (expected,) = expect([TAG], replace(predicted(BODY), camera_turn=extra))
    camera = BODY @ Pose(LENS.mounting.rotation @ extra.T, LENS.mounting.position)
    ahead = camera.inverse().apply(np.array(TAG.position))
    np.testing.assert_allclose(expected.pixel, LENS.project(ahead[None])[0], atol=1e-9)


@pytest.mark.parametrize(
    "tag",
    [
        on_floor(1, -1.3, 0.0),
        on_floor(1, 4.0, 0.8),
        on_floor(1, 0.5, 2.0),
        on_wall(1, 1.2, 0.3, 0.3, facing=0.2),
    ],
    ids=["behind", "too far", "out of the image", "turned away"],
)
def test_a_tag_that_cannot_be_seen_is_not_expected(tag: Tag) -> None:
    assert expect([tag]) == []


def test_a_larger_tag_is_expected_from_further_away() -> None:
    assert len(expect([on_floor(1, 3.2, 0.6, size=0.3)])) == 1
    assert not expect([on_floor(1, 3.2, 0.6)])


def test_tags_where_the_lens_model_folds_back_are_not_expected() -> None:
    ahead = np.array([2.5, 0.0, 1.0]) * 0.3
    pixel = LENS.project(ahead[None])[0]
    assert (pixel > 0).all()
    assert (pixel < LENS.shape[::-1]).all()
    x, y, z = (BODY @ LENS.mounting).apply(ahead).tolist()
    assert not expect([replace(TAG, position=(x, y, z))])


def test_excluded_tags_are_not_expected() -> None:
    other = on_floor(2, 1.2, 0.1)
    (expected,) = expect([TAG, other], exclude=[1])
    assert expected.tag.number == 2


def test_of_many_tags_the_nearest_are_expected() -> None:
    tags = [on_floor(k, 2.0 - 0.1 * k, 0.3) for k in range(MAX_TAGS + 4)]
    expected = expect(tags)
    assert [expectation.tag.number for expectation in expected] == [
        tag.id for tag in tags[: -MAX_TAGS - 1 : -1]
    ]


def test_without_a_map_nothing_is_expected() -> None:
    assert expect([]) == []


def test_an_agent_that_is_nowhere_expects_nothing() -> None:
    lost = Pose(BODY.rotation, np.full(3, math.nan))
    assert expect([TAG], replace(predicted(BODY), pose=lost)) == []


def test_the_covariance_is_that_of_where_it_is_seen() -> None:
    rng = np.random.default_rng(0)
    (expected,) = expect([TAG], predicted(BODY, deviation=0.02, yaw_deviation=0.02))
    centres = []
    for _ in range(2000):
        around = rotation_from_vector(np.array([0, 0, rng.normal(0, 0.02)]))
        tilt = rotation_from_vector(rng.normal(0, TURN_STD, 3))
        shift = rng.normal(0, [0.02, 0.02, HEIGHT_STD])
        body = Pose(around @ BODY.rotation @ tilt, BODY.position + shift)
        centres.append(centre(body, TAG))
    ratio = np.linalg.inv(expected.covariance) @ np.cov(np.array(centres).T)
    # A variance from 2000 numbers has a deviation of 3 %; the lens is taken for even all around.
    np.testing.assert_allclose(ratio, np.eye(2), atol=0.25)
