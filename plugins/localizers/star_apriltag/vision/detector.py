"""Detects the tags in an image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from star_apriltag.vision.edge_fit import refine
from star_core import Array, CameraModel, Image, Rows

WINDOW: Final = 5
"""Edge of the square whose mean is a pixel's threshold, px. One size is faster than OpenCV's three;
in a small one the modules of a far tag merge less."""

MODULE_PIXELS: Final = 8  # in the rectified image from which bits are read
CORRECTION_RATE: Final = 1.0  # of the five wrong bits that a family of distance 11 can correct
MIN_PERIMETER: Final = 0.1  # of the image's longer side: one pixel per module

ORDER: Final = [3, 2, 1, 0]
"""Bottom left, bottom right, top right and top left among OpenCV's corners, which run clockwise
from the top left. Up is as OpenCV draws a tag; the images of the family's authors are rotated by
180°."""


@dataclass(frozen=True, slots=True)
class Found:
    """The tags of one image."""

    tag: Rows  # (K,) numbers
    corners: Array  # (K, 4, 2) px: bottom left, bottom right, top right and top left of each tag
    misfit: Array  # (K,) root mean square deviation of the edges from straight lines, px


class Detector:
    """OpenCV's detector of tag36h11, with corners to a fraction of a pixel by `edge_fit`.

    A tag without clear edges is not reported.

    Args:
        lens: Of the camera.
    """

    def __init__(self, lens: CameraModel) -> None:
        parameters = cv2.aruco.DetectorParameters()
        parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = WINDOW
        parameters.perspectiveRemovePixelPerCell = MODULE_PIXELS
        parameters.errorCorrectionRate = CORRECTION_RATE
        parameters.minMarkerPerimeterRate = MIN_PERIMETER
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
        family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        self._detector = cv2.aruco.ArucoDetector(family, parameters)
        self._lens = lens

    def detect(self, image: Image) -> Found:
        """Return the tags in an image.

        Raises:
            ValueError: It is no gray image of the camera's size.
        """
        image = checked(image, self._lens)
        corners, ids, _ = self._detector.detectMarkers(image)
        if not len(corners):
            return Found(np.zeros(0, np.int64), np.zeros((0, 4, 2)), np.zeros(0))
        rough = np.asarray(corners, np.float64).reshape(-1, 4, 2)[:, ORDER]
        fine, misfit = refine(image, rough, self._lens)
        clear = np.isfinite(misfit)
        return Found(np.ravel(ids).astype(np.int64)[clear], fine[clear], misfit[clear])


def checked(image: Image, lens: CameraModel) -> Image:
    """Return an image whose rows are contiguous in memory.

    Raises:
        ValueError: It is no gray image of the camera's size.
    """
    if image.shape != lens.shape or image.dtype != np.uint8:
        raise ValueError(
            f"image is {image.shape!r} of {image.dtype}, expected {lens.shape!r} of uint8"
        )
    return np.ascontiguousarray(image)
