"""Camera images with the detected tags, side by side."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Final, NamedTuple

import cv2
import numpy as np

from star_core import Detections, Image
from star_core.toolkit import image_with_tags

WHITE: Final = (255, 255, 255)
TILE: Final = 480  # px, width of a camera's image among several
GAP: Final = 6  # px, between two
KEPT: Final = 8  # images of a camera whose tags are awaited
MAX_DELAY: Final = 0.5  # s, of an image with tags behind the newest one
SAME: Final = 5e-4  # s, between the times of an image and of its tags


class Picture(NamedTuple):
    """An image with its tags."""

    image: Image
    tags: Detections


class CameraStream:
    """The latest images of one camera and the tags that the localizer found in them, maybe late."""

    def __init__(self) -> None:
        self._images: deque[tuple[float, Image]] = deque(maxlen=KEPT)
        self._tags: deque[Detections] = deque(maxlen=KEPT)

    def add(self, time: float, image: Image) -> None:
        """Add an image with its time, s."""
        self._images.append((time, image))

    def add_tags(self, tags: Detections) -> None:
        """Add tags of this camera's images."""
        self._tags.append(tags)

    def picture(self) -> Picture | None:
        """Return the newest image with tags, or the newest of all if that is too old."""
        detections, shown = Detections.merged(self._tags), None
        for time, image in reversed(self._images):
            tags = detections.of(np.abs(detections.time - time) < SAME)
            if shown is None:
                newest, shown = time, Picture(image, tags)
            if len(tags.tag) and newest - time <= MAX_DELAY:
                return Picture(image, tags)
        return shown


def mosaic(pictures: Mapping[str, Picture]) -> Image:
    """Return the pictures of some cameras, by name, side by side, (height, width, 3) RGB."""
    columns = math.ceil(math.sqrt(len(pictures)))
    tiles = [_tile(name, picture) for name, picture in pictures.items()]
    height = max(len(tile) for tile in tiles) + GAP
    rows = math.ceil(len(tiles) / columns)
    whole = np.full((rows * height - GAP, columns * (TILE + GAP) - GAP, 3), 255, np.uint8)
    for i, tile in enumerate(tiles):
        y, x = i // columns * height, i % columns * (TILE + GAP)
        whole[y : y + len(tile), x : x + TILE] = tile
    return whole


def _tile(name: str, picture: Picture) -> Image:
    """Return a picture as wide as a tile, with its name."""
    tile = image_with_tags(*picture, TILE)
    for shade, width in ((0, 0, 0), 4), (WHITE, 2):
        cv2.putText(tile, name, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.7, shade, width, cv2.LINE_AA)
    return tile
