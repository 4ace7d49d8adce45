"""Draws a tag of the map as a camera should see it."""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from star_apriltag.vision.tag_poses import CELLS, MODULES
from star_core import CameraModel, Pose

Picture = NDArray[np.float32]

SAMPLES: Final = 3  # per pixel along each side
BLUR_STD: Final = 0.7  # px, of a small lens; from 0.4 to 1.1 is as good


class Region(NamedTuple):
    """A region of an image: the first column and row, and the ones past the last."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def corners(self) -> Picture:
        """(4, 2) px; the center of the first pixel is at (0, 0)."""
        left, top, right, bottom = self
        points = [[left, top], [right, top], [right, bottom], [left, bottom]]
        return np.array(points, np.float32) - np.float32(0.5)


class Template(NamedTuple):
    """Expected content of a region."""

    gray: Picture  # (h, w) from 0 for ink to 1 for paper
    paper: Picture  # (h, w) share of each pixel that the tag with its border covers
    code: Picture  # (h, w) share of each pixel that its code covers


def template(number: int, size: float, tag: Pose, lens: CameraModel, region: Region) -> Template:
    """Return a tag of family 36h11 as it appears in a region of the image.

    Each pixel is the mean over `SAMPLES` by `SAMPLES` rays, blurred like a lens. The region has at
    least one pixel of the image around it; the tag's pose is that in the camera, its size in m.
    """
    left, top, right, bottom = region
    rays = lens.rays[top - 1 : bottom + 1, left - 1 : right + 1]
    fine = cv2.resize(rays, None, fx=SAMPLES, fy=SAMPLES, interpolation=cv2.INTER_LINEAR)
    fine = np.ascontiguousarray(fine[SAMPLES:-SAMPLES, SAMPLES:-SAMPLES])
    scale, middle = MODULES / size, (CELLS - 1) / 2
    to_cells = np.array([[scale, 0, middle], [0, -scale, middle], [0, 0, 1]])
    plane = np.column_stack([tag.rotation[:, :2], tag.position])  # x, y and 1 to a ray
    cells = cv2.perspectiveTransform(fine, to_cells @ np.linalg.inv(plane))
    cells[np.isnan(fine)] = -1.0
    columns, rows = cv2.split(cells)
    seen = cv2.remap(
        _print(number), columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT
    )
    seen = cv2.resize(seen, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
    seen = cv2.GaussianBlur(seen, (0, 0), BLUR_STD)
    light, paper, code = (np.asarray(seen[..., i], np.float32) for i in range(3))
    light /= np.maximum(paper, _MIN_PAPER)
    return Template(light, paper, code)


@cache
def _print(number: int) -> Picture:
    """Return a tag's cells, (CELLS, CELLS, 3), top row first: gray, paper and code."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    cells = np.ones((CELLS, CELLS, 3), np.float32)
    cells[1:-1, 1:-1, 0] = cv2.aruco.generateImageMarker(family, number, MODULES) > 0
    cells[..., 2] = 0
    cells[2:-2, 2:-2, 2] = 1
    return cells


_MIN_PAPER = np.float32(1e-3)
