"""Finds dark quadrilaterals in an image: candidates for the outer borders of tags."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import cv2
import numpy as np

from star_apriltag.vision.tag_poses import MODULES
from star_core import Array, Image

MIN_MODULE: Final = 1.0  # px, of the longer side of the box around a tag; shorter codes are lost
MIN_NARROW_MODULE: Final = 0.5  # px, of the shorter side of that box

WINDOW: Final = 5
"""Edge of the square whose mean is a pixel's threshold, px. In a small one the modules of a far tag
merge less; of a large tag it finds the edges, which suffices."""

MIN_DARKNESS: Final = 5  # gray values below that mean, from which on a pixel is dark
MIN_FILL: Final = 1.6  # dark pixels per pixel of the longer side: a closed border has about two
MAX_DEVIATION: Final = 0.05  # of a contour from its polygon, per length of the contour
IMAGE_BORDER: Final = 3.0  # px at the edge of the image where no corner is accepted
MIN_HEIGHT: Final = 120  # px, of the coarsest level of a pyramid


def pyramid(image: Image) -> Iterator[Image]:
    """Yield an image, and the same at half the resolution, a quarter and so on.

    The edges of a large tag in a blurred image are too soft for `WINDOW`; in a coarser one they are
    sharp.
    """
    yield image
    while min(image.shape) >= 2 * MIN_HEIGHT:
        height, width = (2 * (size // 2) for size in image.shape)
        half = (width // 2, height // 2)
        image = np.asarray(
            cv2.resize(image[:height, :width], half, interpolation=cv2.INTER_AREA), np.uint8
        )
        yield image


def dark_quads(image: Image) -> Array:
    """Return the (K, 4, 2) corners of dark, convex quadrilaterals, px, anticlockwise in the image.

    They are the outer contours of the regions of dark pixels that are connected along their edges:
    over a corner, a tag's border would connect to what lies beyond a narrow white margin. Corners
    are exact to about a pixel.
    """
    dark = cv2.adaptiveThreshold(
        image, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, WINDOW, MIN_DARKNESS
    )
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(dark, connectivity=4)
    width, height, area = boxes[:, 2], boxes[:, 3], boxes[:, 4]
    longer, shorter = np.maximum(width, height), np.minimum(width, height)
    large = (longer >= MODULES * MIN_MODULE) & (area >= MIN_FILL * longer)
    large &= shorter >= MODULES * MIN_NARROW_MODULE
    large[0] = False  # all that is not dark
    outlines = []
    for label in np.flatnonzero(large).tolist():
        left, top, across, down, _ = boxes[label].tolist()
        region = cv2.inRange(labels[top : top + down, left : left + across], label, label)
        (contour, *_), _ = cv2.findContours(
            region, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(left, top)
        )
        quad = cv2.approxPolyDP(contour, max(MAX_DEVIATION * len(contour), 1.0), closed=True)
        if len(quad) == 4 and cv2.isContourConvex(quad):  # noqa: PLR2004 -- sides of a square
            outlines.append(quad[::-1] if cv2.contourArea(quad, oriented=True) > 0 else quad)
    quads = np.reshape(np.array(outlines, np.float64), (-1, 4, 2))
    last = np.array(image.shape[::-1]) - 1 - IMAGE_BORDER
    inside: Array = quads[((quads >= IMAGE_BORDER) & (quads <= last)).all(axis=(1, 2))]
    return inside
