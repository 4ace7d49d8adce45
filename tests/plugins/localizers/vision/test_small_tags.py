"""Tags with modules of about a pixel, large blurred ones, and what only looks like a tag."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from star_apriltag.vision.detector import Detector, TagDetections
from star_apriltag.vision.quads import dark_quads
from star_apriltag.vision.tag_code import MIN_CORRELATION, module_grid, read_codes
from star_core import Array, Camera, Image, Tag
from star_core.toolkit import CameraModel
from tests.plugins.localizers.vision.conftest import LENS, hovering, on_floor, paint, tag_corners

FAMILY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
PHOTOS = os.environ.get("STAR_TAG_PHOTOS")


@pytest.fixture(scope="module")
def small() -> list[Tag]:
    """Tags all over the floor in front of the camera, with sides of 11 to 17 px."""
    rng = np.random.default_rng(0)
    return [
        on_floor(41 * i, x, y, yaw=float(rng.uniform(0, 6)), size=(0.057 + 0.003 * i) * (0.6 + x))
        for i, (x, y) in enumerate((x, y) for x in (0.45, 0.6, 0.8) for y in (-0.3, -0.1, 0.1, 0.3))
    ]


@pytest.fixture(scope="module")
def image(small: list[Tag]) -> Image:
    return paint(hovering(), small)


def lens_of(image: Image) -> CameraModel:
    """A LENS without distortion for an image of any size."""
    height, width = image.shape
    matrix = (float(width), float(width), width / 2, height / 2)
    return CameraModel(
        replace(Camera(), width=width, height=height, matrix=matrix, distortion=(0.0,) * 5)
    )


def sides(corners: Array) -> Array:
    length: Array = np.linalg.norm(corners - np.roll(corners, 1, axis=-2), axis=-1)
    return length


def opencv(image: Image) -> list[int]:
    quads, tags, _ = cv2.aruco.ArucoDetector(FAMILY).detectMarkers(image)
    return [int(tag) for tag in np.ravel(tags)] if len(quads) else []


def test_tags_of_eleven_to_seventeen_pixels_are_found(small: list[Tag], image: Image) -> None:
    expected = {tag.id: tag_corners(hovering(), tag) for tag in small}
    edges = np.array([sides(pixels).mean() for pixels in expected.values() if pixels is not None])
    assert len(edges) == len(small)
    assert edges.min() == pytest.approx(11, abs=1)
    assert edges.max() == pytest.approx(16.5, abs=1)
    detections = Detector(LENS).detect(image)
    assert sorted(detections.tag.tolist()) == sorted(expected)
    assert len(opencv(image)) < len(small)
    errors = [
        np.linalg.norm(corners - expected[tag], axis=1).mean()
        for tag, corners in zip(detections.tag.tolist(), detections.corners, strict=True)
    ]
    assert np.median(errors) < 0.2


@pytest.mark.parametrize("scale", [2, 3, 6])
def test_the_resolution_of_an_image_does_not_matter(
    small: list[Tag], image: Image, scale: int
) -> None:
    large = np.asarray(
        cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), np.uint8
    )
    detections, as_it_is = (
        Detector(lens_of(large)).detect(large),
        Detector(lens_of(image)).detect(image),
    )
    assert sorted(detections.tag.tolist()) == sorted(tag.id for tag in small)
    for tag, corners in zip(as_it_is.tag.tolist(), as_it_is.corners, strict=True):
        (large_corners,) = detections.corners[detections.tag == tag]
        assert np.linalg.norm((large_corners + 0.5) / scale - 0.5 - corners, axis=1).mean() < 0.3


def test_a_small_tag_is_found_in_a_large_image(image: Image) -> None:
    wide = np.full((1080, 1920), 115, np.uint8)
    wide[600 : 600 + image.shape[0], 1200 : 1200 + image.shape[1]] = image
    assert len(Detector(lens_of(wide)).detect(wide).tag) == 12


def test_a_tag_is_reported_once() -> None:
    picture = paint(hovering(), [on_floor(5, 0.6, 0.0, size=0.3)])  # found in two resolutions
    assert Detector(LENS).detect(picture).tag.tolist() == [5]


def test_the_same_number_can_be_seen_twice() -> None:
    twins = [on_floor(5, 0.6, -0.1, size=0.1), on_floor(5, 0.6, 0.1, size=0.1)]
    assert Detector(LENS).detect(paint(hovering(), twins)).tag.tolist() == [5, 5]


@pytest.mark.parametrize("turns", range(4))
def test_a_tag_is_read_in_every_direction(turns: int) -> None:
    tag = np.pad(cv2.aruco.generateImageMarker(FAMILY, 99, 8), 1, constant_values=255)
    large = np.kron(np.rot90(tag, turns), np.ones((6, 6))).astype(np.uint8)
    picture = np.pad(large, 60, constant_values=180)
    detections = Detector(lens_of(picture)).detect(picture)
    assert detections.tag.tolist() == [99]
    first, last = 65.5, 113.5  # px: the edges of the black square
    square = np.array([[first, last], [last, last], [last, first], [first, first]])
    np.testing.assert_allclose(detections.corners[0], np.roll(square, -turns, axis=0), atol=0.15)


@pytest.mark.parametrize("seed", range(4))
def test_squares_that_look_like_tags_are_none(seed: int) -> None:
    """Dark borders on paper around random modules, ArUco's and AprilTag's 36h10 codes."""
    rng = np.random.default_rng(seed)
    picture = np.full((540, 960), 150.0, np.float32)
    others = [
        cv2.aruco.getPredefinedDictionary(name)
        for name in (cv2.aruco.DICT_6X6_250, cv2.aruco.DICT_APRILTAG_36H10)
    ]
    for center in np.mgrid[60:960:70, 60:540:70].reshape(2, -1).T:
        code = rng.integers(0, 2, (6, 6)) * 255
        if rng.random() < 0.6:
            marker = cv2.aruco.generateImageMarker(
                others[rng.integers(2)], int(rng.integers(250)), 8
            )
            code = np.asarray(marker[1:-1, 1:-1], np.int64)
        square = np.kron(np.pad(np.pad(code, 1), 1, constant_values=230), np.ones((5, 5)))
        angle, size = rng.uniform(0, 6), rng.uniform(0.5, 0.9)
        turn = size * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        shift = center - turn @ [25, 25]
        cv2.warpAffine(
            square.astype(np.float32),
            np.column_stack([turn, shift]),
            (960, 540),
            dst=picture,
            borderMode=cv2.BORDER_TRANSPARENT,
        )
    noisy = cv2.GaussianBlur(picture, (0, 0), 0.6) + rng.normal(0, 3, picture.shape)
    image = np.clip(noisy, 0, 255).astype(np.uint8)
    quads = dark_quads(image)
    assert len(quads) > 60
    assert read_codes(module_grid(image, quads)).correlation.max() < MIN_CORRELATION - 0.02
    assert not len(Detector(lens_of(image)).detect(image).tag)


@pytest.mark.skipif(PHOTOS is None, reason="STAR_TAG_PHOTOS names no folder of photographs")
def test_photographs_agree_with_the_apriltag_library() -> None:
    """Each ``NAME.jpg`` has a ``NAME.txt``: a number and four corners per line, by that library.

    Its pixels begin at (0.5, 0.5), OpenCV's at (0, 0).
    """
    listed = sorted(Path(PHOTOS or "").glob("*.txt"))
    assert listed
    for path in listed:
        rows = [re.findall(r"[-\d.]+", line) for line in path.read_text().splitlines()]
        reference = [
            (int(row[0]), np.array(row[1:], float).reshape(4, 2) - 0.5) for row in rows if row
        ]
        read = cv2.imread(str(path.with_suffix(".jpg")), cv2.IMREAD_GRAYSCALE)
        assert read is not None
        image = np.asarray(read, np.uint8)
        detections = Detector(lens_of(image)).detect(image)
        distances = [
            off for tag, corners in reference for off in _distances(detections, tag, corners)
        ]
        assert len(distances) >= len(reference) - max(1, len(reference) // 10)
        assert np.median(distances) < 0.5
        assert len(detections.tag) >= len(opencv(image))


def _distances(detections: TagDetections, tag: int, corners: Array) -> list[float]:
    """Return the mean distance of the corners of a tag from those found, px, if it is found."""
    turned = np.array([np.roll(corners[::way], k, axis=0) for way in (1, -1) for k in range(4)])
    distances = [
        float(np.linalg.norm(turned - candidate, axis=2).mean(axis=1).min())
        for candidate in detections.corners[detections.tag == tag]
    ]
    return sorted(d for d in distances if d < sides(corners).mean() / 2)[:1]
