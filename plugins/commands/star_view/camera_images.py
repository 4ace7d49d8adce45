"""Camera images with the AprilTags in them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any, Final, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from star_core import Image

ColorImage: TypeAlias = NDArray[np.uint8]
"""(height, width, 3) red, green and blue."""

TAG: Final = (0, 220, 90)
TEXT: Final = (255, 255, 255)
TILE: Final = 480  # px, width of a camera's image among several
GAP: Final = 6  # px, between two


def mosaic(images: Mapping[str, Image]) -> ColorImage:
    """Return the images of some cameras, by name, side by side, with the tags in them."""
    columns = math.ceil(math.sqrt(len(images)))
    tiles = [_tile(name, image) for name, image in images.items()]
    height = max(len(tile) for tile in tiles) + GAP
    rows = math.ceil(len(tiles) / columns)
    whole = np.full((rows * height - GAP, columns * (TILE + GAP) - GAP, 3), 255, np.uint8)
    for i, tile in enumerate(tiles):
        y, x = i // columns * height, i % columns * (TILE + GAP)
        whole[y : y + len(tile), x : x + TILE] = tile
    return whole


def _tile(name: str, image: Image) -> ColorImage:
    """Return an image in color, as wide as a tile, with its name, and outlines of the tags."""
    corners, numbers, _ = _detector().detectMarkers(image)
    scale = TILE / image.shape[1]
    size = TILE, round(image.shape[0] * scale)
    tile = cv2.cvtColor(cv2.resize(image, size), cv2.COLOR_GRAY2RGB)
    for tag, outline in zip(() if numbers is None else np.ravel(numbers), corners, strict=True):
        pixels = np.round(outline.reshape(-1, 1, 2) * scale).astype(np.int32)
        cv2.polylines(tile, [pixels], isClosed=True, color=TAG, thickness=2)
        _write(tile, str(tag), (int(pixels[:, 0, 0].max()) + 4, int(pixels[:, 0, 1].max())), TAG)
    _write(tile, name, (8, 22), TEXT)
    return np.asarray(tile, np.uint8)


def _write(image: Any, text: str, at: tuple[int, int], color: tuple[int, int, int]) -> None:
    for shade, width in ((0, 0, 0), 4), (color, 2):
        cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.7, shade, width, cv2.LINE_AA)


@cache
def _detector() -> Any:
    """Return OpenCV's detector, for tags of a few pixels."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = 5
    parameters.perspectiveRemovePixelPerCell = 8
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    return cv2.aruco.ArucoDetector(family, parameters)
