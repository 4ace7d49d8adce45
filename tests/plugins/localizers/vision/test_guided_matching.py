"""Tags that the detector does not find, found where the map has them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_apriltag.vision.body_pose import Prediction
from star_apriltag.vision.detector import Detector
from star_apriltag.vision.expected_tags import ExpectedTags
from star_apriltag.vision.guided_matching import (
    TagMatch,
    _peak,
    match_tag,
    without_overlaps,
)
from star_apriltag.vision.tag_poses import MapTag
from star_core import Array, Image, Pose, Tag
from star_core.toolkit import rotation_from_vector
from tests.plugins.localizers.vision.conftest import LENS, hovering, on_floor, paint, predicted

BODY = hovering(yaw=0.1)
FAR = on_floor(1, 1.9, 0.2, yaw=0.5)
SURE = {"deviation": 0.03, "yaw_deviation": 0.01}


def guided(
    image: Image, tag: Tag, prediction: Prediction | None = None, body: Pose = BODY
) -> TagMatch | None:
    """Return the match of a tag with the right prediction, or another one."""
    guide = prediction or predicted(body, **SURE)
    (expected,) = ExpectedTags(LENS, [MapTag(tag)]).expect(guide)
    return match_tag(image, expected, LENS)


def centre(tag: Tag, body: Pose = BODY) -> Array:
    ahead = (body @ LENS.mounting).inverse().apply(np.array(tag.position))
    pixel: Array = LENS.project(ahead[None])[0]
    return pixel


def off(by: Sequence[float], yaw: float = 0.0) -> Prediction:
    """Returns a prediction that is off by some way, m, and a turn."""
    pose = Pose(
        rotation_from_vector(np.array([0, 0, yaw])) @ BODY.rotation, BODY.position + np.array(by)
    )
    return replace(predicted(BODY, deviation=0.04, yaw_deviation=0.02), pose=pose)


@pytest.fixture(scope="module")
def far() -> Image:
    return paint(BODY, [FAR])


@pytest.fixture(scope="module")
def floor() -> Image:
    return paint(BODY, [])


@pytest.mark.parametrize("distance", [1.9, 2.1, 2.4])
@pytest.mark.parametrize("yaw", [0.0, 0.7, 2.5])
def test_a_tag_out_of_the_detectors_range_is_found(distance: float, yaw: float) -> None:
    tag = on_floor(40, distance, 0.2, yaw)
    image = paint(BODY, [tag])
    assert not len(Detector(LENS).detect(image).tag)
    match = guided(image, tag, off([0.05, -0.04, 0.0], yaw=0.02))
    assert match is not None
    assert match.tag == 40
    np.testing.assert_allclose(match.pixel, centre(tag), atol=0.5)


def test_what_is_found_is_a_measurement_of_the_tags_centre(far: Image) -> None:
    match = guided(far, FAR)
    assert match is not None
    np.testing.assert_allclose(match.view.points, [FAR.position])
    np.testing.assert_allclose(match.view.rays, [LENS.undistort(match.pixel)])
    np.testing.assert_allclose(match.view.delay, [LENS.row_delay(match.pixel)])


def test_a_farther_tag_is_measured_less_surely(far: Image) -> None:
    near = on_floor(1, 1.2, 0.1)
    matches = guided(paint(BODY, [near]), near), guided(far, FAR)
    deviations = [match.view.deviation for match in matches if match is not None]
    assert len(deviations) == 2
    assert deviations[0] < deviations[1]


def test_a_covered_tag_is_not_found(floor: Image) -> None:
    assert guided(floor, FAR) is None


@pytest.mark.parametrize("number", range(2, 12))
@pytest.mark.parametrize("x", [1.2, 1.9])
def test_another_tag_at_its_position_is_not_matched(x: float, number: int) -> None:
    image = paint(BODY, [on_floor(number, x, 0.2, yaw=0.5)])
    assert guided(image, on_floor(1, x, 0.2, yaw=0.5)) is None


def test_its_neighbour_on_the_sheet_is_not_taken_for_it() -> None:
    image = paint(BODY, [on_floor(2, 1.9, 0.41)])
    assert guided(image, on_floor(1, 1.9, 0.2), off([0, 0.1, 0])) is None


def test_between_two_tags_that_look_the_same_none_is_chosen() -> None:
    left, right, between = (on_floor(1, 1.9, y) for y in (0.31, 0.09, 0.2))
    wide = predicted(BODY, deviation=0.1, yaw_deviation=0.03)
    for alone in (left, right):
        assert guided(paint(BODY, [alone]), between, wide) is not None
    assert guided(paint(BODY, [left, right]), between, wide) is None


def test_of_two_matches_at_one_pixel_the_better_is_kept(far: Image) -> None:
    own = guided(far, FAR)
    assert own is not None
    neighbor = own._replace(tag=2, pixel=own.pixel + 0.4, correlation=own.correlation - 0.2)
    aside = np.array([18.0, 0.0])
    assert without_overlaps([neighbor, own], ()) == (own,)
    beside = neighbor._replace(pixel=own.pixel + aside, corners=own.corners + aside)
    assert without_overlaps([beside, own], ()) == (beside, own)


def test_a_match_on_a_detected_tag_is_discarded(far: Image) -> None:
    match = guided(far, FAR)
    assert match is not None
    assert without_overlaps([match], [match.corners + 0.5]) == ()
    assert without_overlaps([match], [match.corners + 30.0]) == (match,)


def checkered(period: int) -> Image:
    v, u = np.indices(LENS.shape)
    return np.where((u // period + v // period) % 2, 205, 35).astype(np.uint8)


def rough(seed: int) -> Image:
    grains = np.random.default_rng(seed).integers(0, 256, (61, 81), np.uint8)
    return np.kron(grains, np.ones((4, 4), np.uint8))


@pytest.mark.parametrize(
    "image",
    [
        *map(checkered, (4, 6, 9)),
        *map(rough, range(8)),
        *(np.full(LENS.shape, gray, np.uint8) for gray in (0, 115, 255)),
    ],
)
def test_in_another_texture_nothing_is_found(image: Image) -> None:
    assert guided(image, FAR) is None


def test_noise_in_the_dark_is_no_tag(far: Image) -> None:
    dark = (far // 32).astype(np.uint8)
    assert guided(far, FAR) is not None
    assert guided(dark, FAR) is None


def test_an_unsure_agent_is_not_guided(far: Image) -> None:
    assert guided(far, FAR, predicted(BODY, **SURE)) is not None
    assert guided(far, FAR, predicted(BODY, deviation=0.5, yaw_deviation=0.05)) is None
    assert guided(far, FAR, predicted(BODY, deviation=0.03, yaw_deviation=0.15)) is None


def test_an_agent_that_knows_nothing_of_its_doubt_is_not_guided(far: Image) -> None:
    unknown = replace(predicted(BODY), covariance=np.full((3, 3), math.nan))
    assert guided(far, FAR, unknown) is None


def test_tags_farther_off_than_the_belief_allows_do_not_match(far: Image) -> None:
    assert guided(far, replace(FAR, position=(1.9, 0.75, 0.0))) is None
    assert guided(far, replace(FAR, position=(1.9, 0.25, 0.0))) is not None


def test_a_tag_at_the_images_edge_is_found_by_what_is_seen_of_it() -> None:
    cut = on_floor(1, 0.85, 1.25)
    assert 0 < centre(cut)[0] < 15  # px: its rim is out
    match = guided(paint(BODY, [cut]), cut)
    assert match is not None
    np.testing.assert_allclose(match.pixel, centre(cut), atol=0.7)


def test_a_tag_of_which_too_little_is_in_the_image_is_not_found() -> None:
    cut = on_floor(1, 0.85, 1.35)
    assert 0 < centre(cut)[0] < 5  # px
    assert guided(paint(BODY, [cut]), cut) is None


def test_a_tag_that_fills_the_image_is_not_matched() -> None:
    small, large = (on_floor(1, 0.8, 0.1, size=size) for size in (0.3, 0.7))
    assert guided(paint(BODY, [small]), small) is not None
    assert guided(paint(BODY, [large]), large) is None


@given(st.integers(-9, 9), st.integers(-9, 9))
def test_an_image_that_is_shifted_shifts_what_is_found(far: Image, du: int, dv: int) -> None:
    still, moved = guided(far, FAR), guided(np.roll(far, (dv, du), (0, 1)), FAR)
    assert still is not None
    assert moved is not None
    np.testing.assert_allclose(moved.pixel - still.pixel, [du, dv], atol=1e-3)


@given(st.floats(0.4, 1.1), st.floats(0.0, 30.0))
def test_exposure_does_not_matter(far: Image, gain: float, offset: float) -> None:
    still = guided(far, FAR)
    other = guided(np.rint(far * gain + offset).astype(np.uint8), FAR)
    assert still is not None
    assert other is not None
    np.testing.assert_allclose(other.pixel, still.pixel, atol=0.1)


@given(st.floats(-0.45, 0.45), st.floats(-0.45, 0.45))
def test_between_pixels_it_is_at_the_summit(u: float, v: float) -> None:
    rows, columns = np.mgrid[:11, :13]
    likeness = (0.9 - 0.02 * (columns - 6 - u) ** 2 - 0.03 * (rows - 4 - v) ** 2).clip(0)
    assert _peak(likeness.astype(np.float32)) == pytest.approx((6 + u, 4 + v), abs=1e-3)


@pytest.mark.parametrize(("best", "is_peak"), [(0.55, False), (0.65, True), (math.inf, False)])
def test_what_is_not_like_the_tag_is_no_peak(best: float, is_peak: bool) -> None:  # noqa: FBT001
    likeness = np.zeros((9, 9), np.float32)
    likeness[4, 5] = best
    assert (_peak(likeness) is not None) == is_peak


@pytest.mark.parametrize(("row", "column"), [(0, 4), (8, 4), (4, 0), (4, 8)])
def test_a_peak_at_the_edge_may_be_higher_beyond_it(row: int, column: int) -> None:
    likeness = np.zeros((9, 9), np.float32)
    likeness[row, column] = 0.9
    assert _peak(likeness) is None
