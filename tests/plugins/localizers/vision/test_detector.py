import math

import numpy as np
import pytest

from star_apriltag.vision.detector import Detector, refine
from star_core import Image
from tests.plugins.localizers.vision.conftest import LENS, hovering, on_floor, paint, tag_corners

SHAPE = (244, 324)


def test_tag_corners_up_to_1_5_m_are_within_a_sixth_of_a_pixel() -> None:
    detector = Detector(LENS)
    square, count = 0.0, 0
    for i, ahead in enumerate(np.linspace(0.55, 1.2, 8)):  # 0.95 to 1.45 m from the camera
        body = hovering(yaw=i, roll=0.02, pitch=-0.03)
        side = 0.2 * math.sin(5 * i)
        x, y, _ = body.apply(np.array([ahead, side, 0]))
        tag = on_floor(61 * i, x, y, yaw=2.0 * i)
        expected = tag_corners(body, tag)
        detections = detector.detect(paint(body, [tag]))
        assert expected is not None
        assert detections.tag.tolist() == [tag.id]
        square += float(np.square(detections.corners[0] - expected).sum(axis=1).mean())
        count += 1
    assert math.sqrt(square / count) <= 1 / 6


def test_corners_run_from_the_bottom_left_anticlockwise() -> None:
    detections = Detector(LENS).detect(paint(hovering(), [on_floor(3, 0.7, 0.0, yaw=-math.pi / 2)]))
    (bottom_left, bottom_right, top_right, top_left), *_ = detections.corners  # x points right
    assert bottom_left[0] < bottom_right[0]
    assert top_left[0] < top_right[0]
    assert top_left[1] < bottom_left[1]
    assert top_right[1] < bottom_right[1]


def test_two_tags_are_found_in_one_image() -> None:
    tags = [on_floor(7, 0.7, -0.105), on_floor(8, 0.7, 0.105)]
    detections = Detector(LENS).detect(paint(hovering(), tags))
    assert sorted(detections.tag.tolist()) == [7, 8]
    assert detections.corners.shape == (2, 4, 2)
    assert (detections.misfit < 0.2).all()


@pytest.mark.parametrize("shape", [(240, 324), (0, 0), (244 * 324,), (244, 324, 3)])
def test_an_image_of_another_size_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"expected \(244, 324\) of uint8"):
        Detector(LENS).detect(np.zeros(shape, np.uint8))


@pytest.mark.parametrize(
    "image",
    [
        *(np.full(SHAPE, gray, np.uint8) for gray in (0, 127, 255)),
        *np.random.default_rng(0).integers(0, 256, (5, *SHAPE), np.uint8),
    ],
)
def test_nothing_is_found_in_an_image_of_one_gray_or_noise(image: Image) -> None:
    detections = Detector(LENS).detect(image)
    assert detections.tag.shape == (0,)
    assert detections.corners.shape == (0, 4, 2)


def test_an_image_may_be_a_view_of_a_larger_one() -> None:
    image = paint(hovering(), [on_floor(3, 0.7, 0.0)])
    wide = np.repeat(image, 2, axis=1)
    assert Detector(LENS).detect(wide[:, ::2]).tag.tolist() == [3]


def test_a_tag_that_was_cut_off_is_not_reported() -> None:
    image = paint(hovering(), [on_floor(3, 0.7, 0.0)]).copy()
    image[image.shape[0] // 2 :] = 0
    image[: image.shape[0] // 3] = 0
    assert not len(Detector(LENS).detect(image).tag)


def test_sides_without_contrast_have_no_corners() -> None:
    square = np.array([[100.0, 140.0], [140.0, 140.0], [140.0, 100.0], [100.0, 100.0]])
    _, misfit = refine(np.full(SHAPE, 90, np.uint8), square[None], LENS)
    assert np.isnan(misfit).all()


def test_corner_refinement_recovers_from_a_pixel_of_error() -> None:
    tag = on_floor(11, 0.65, 0.05)
    expected = tag_corners(hovering(), tag)
    assert expected is not None
    off = expected + np.array([[1.0, -0.5], [-0.7, -0.7], [0.5, 1.0], [0.6, -0.6]])
    nothing = np.array([[5.0, 30.0], [30.0, 30.0], [30.0, 5.0], [5.0, 5.0]])
    pixels, misfit = refine(paint(hovering(), [tag]), np.stack([nothing, off]), LENS)
    assert np.isfinite(misfit).tolist() == [False, True]
    assert np.abs(pixels[1] - expected).max() < 0.2
