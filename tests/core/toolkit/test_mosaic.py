"""Gray images from mosaics."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Image
from star_core.toolkit import gray_from_mosaic

KINDS = ["bayer_rggb", "bayer_bggr", "bayer_grbg", "bayer_gbrg"]
RESPONSE = {"r": 0.5, "g": 1.0, "b": 0.4}


def mosaic(gray: Image, pixels: str) -> Image:
    """Return what a color sensor sends of something gray."""
    rows, columns = np.indices(gray.shape) % 2
    response = np.array([RESPONSE[color] for color in pixels.removeprefix("bayer_")])
    return np.asarray(np.rint(gray * response[2 * rows + columns]), np.uint8)


def pattern(height: int = 60, width: int = 80) -> Image:
    """Return black and white blocks with edges between any two pixels."""
    rng = np.random.default_rng(0)
    blocks = np.kron(rng.integers(0, 2, (height // 3 + 1, width // 5 + 1)), np.ones((3, 5)))
    return (40 + 180 * blocks[:height, :width]).astype(np.uint8)


@pytest.mark.parametrize("pixels", KINDS)
@pytest.mark.parametrize("shape", [(60, 80), (61, 79)])
def test_black_and_white_keeps_its_resolution(pixels: str, shape: tuple[int, int]) -> None:
    gray = pattern(*shape)
    read = gray_from_mosaic(mosaic(gray, pixels), pixels)
    assert read.shape == gray.shape
    assert read.dtype == np.uint8
    assert np.abs(read.astype(int) - gray)[4:-4, 4:-4].mean() < 8
    assert np.corrcoef(read.ravel(), gray.ravel())[0, 1] > 0.99
    assert np.corrcoef(mosaic(gray, pixels).ravel(), gray.ravel())[0, 1] < 0.95


@pytest.mark.parametrize("pixels", KINDS)
def test_a_colored_surface_becomes_as_bright_as_its_green(pixels: str) -> None:
    surface = np.full((30, 40), 200, np.uint8)
    assert (np.abs(gray_from_mosaic(mosaic(surface, pixels), pixels).astype(int) - 200) <= 1).all()


def test_a_gray_image_stays_as_it_is() -> None:
    image = pattern()
    assert gray_from_mosaic(image, "gray") is image


def test_black_pixels_stay_black() -> None:
    assert not gray_from_mosaic(np.zeros((20, 20), np.uint8), "bayer_rggb").any()
