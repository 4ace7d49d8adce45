"""What a tag of the map looks like from some place."""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from star_apriltag.vision.landmark import CELLS, MODULES
from star_core import CameraModel, Pose

Picture = NDArray[np.float32]

FINE: Final = 3  # samples to a pixel, along each side
BLUR: Final = 0.7  # px, deviation of a small lens's spread of light; from 0.4 to 1.1 is as good


class Region(NamedTuple):
    """A part of an image: the first column and row, and the ones past the last."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def corners(self) -> Picture:
        """(4, 2) px; the middle of the first pixel is at (0, 0)."""
        left, top, right, bottom = self
        points = [[left, top], [right, top], [right, bottom], [left, bottom]]
        return np.array(points, np.float32) - np.float32(0.5)


class Template(NamedTuple):
    """What a region is expected to show.

    Attributes:
        grey: (h, w) from 0 for ink to 1 for paper.
        paper: (h, w) share of each pixel that the tag and its rim fill.
        code: (h, w) share of each pixel that its code fills, which is all that is its own.
    """

    grey: Picture
    paper: Picture
    code: Picture


def template(number: int, size: float, tag: Pose, lens: CameraModel, region: Region) -> Template:
    """Return what a tag of family 36h11 looks like in a region of the image.

    Each pixel is the mean over rays all over it, spread as a lens spreads light.

    Args:
        number: Of the tag.
        size: Its edge, m.
        tag: In the camera.
        lens: What it is seen through.
        region: With at least one pixel of the image around it.
    """
    left, top, right, bottom = region
    rays = lens.rays[top - 1 : bottom + 1, left - 1 : right + 1]
    fine = cv2.resize(rays, None, fx=FINE, fy=FINE, interpolation=cv2.INTER_LINEAR)
    fine = np.ascontiguousarray(fine[FINE:-FINE, FINE:-FINE])
    scale, middle = MODULES / size, (CELLS - 1) / 2
    to_cells = np.array([[scale, 0, middle], [0, -scale, middle], [0, 0, 1]])
    plane = np.column_stack([tag.rotation[:, :2], tag.position])  # x, y and 1 to a ray
    cells = cv2.perspectiveTransform(fine, to_cells @ np.linalg.inv(plane))
    cells[np.isnan(fine)] = -1.0  # no ray, no paper
    columns, rows = cv2.split(cells)
    seen = cv2.remap(
        _print(number), columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT
    )
    seen = cv2.resize(seen, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
    seen = cv2.GaussianBlur(seen, (0, 0), BLUR)
    light, paper, code = (np.asarray(seen[..., i], np.float32) for i in range(3))
    light /= np.maximum(paper, _LEAST_PAPER)
    return Template(light, paper, code)


@cache
def _print(number: int) -> Picture:
    """What is printed, (CELLS, CELLS, 3), top row first: light, paper and code."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    cells = np.ones((CELLS, CELLS, 3), np.float32)
    cells[1:-1, 1:-1, 0] = cv2.aruco.generateImageMarker(family, number, MODULES) > 0
    cells[..., 2] = 0
    cells[2:-2, 2:-2, 2] = 1
    return cells


_LEAST_PAPER = np.float32(1e-3)
