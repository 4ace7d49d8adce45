"""Gray images from the raw mosaic of a color camera's sensor."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from star_core.messages.telemetry import Image

WINDOW: Final = 15  # pixels of one color along each side, over which colors are balanced
MIN_LEVEL: Final = np.float32(1.0)  # gray value, of a mean that is divided by


def gray_from_mosaic(mosaic: Image, pixels: str) -> Image:
    """Return a gray image with the resolution of a Bayer mosaic.

    Each of the four kinds of pixels is scaled to the local mean of the green ones. What is black
    and white, as tags and chessboards are, keeps its full resolution then, which it loses when
    colors are interpolated (``benchmarks/mosaic.py``).

    Args:
        mosaic: (height, width) as the sensor sends it.
        pixels: The colors of its first two pixels, and of those below them: ``bayer_rggb``,
            ``bayer_bggr``, ``bayer_grbg`` or ``bayer_gbrg``; ``gray`` returns the image as it is.
    """
    if pixels == "gray":
        return mosaic
    height, width = mosaic.shape
    even = cv2.copyMakeBorder(mosaic, 0, height % 2, 0, width % 2, cv2.BORDER_REFLECT_101)
    kinds = np.asarray(even, np.float32).reshape(len(even) // 2, 2, -1, 2).transpose(1, 3, 0, 2)
    means = [
        [cv2.blur(np.ascontiguousarray(kind), (WINDOW, WINDOW)) for kind in row] for row in kinds
    ]
    level = np.asarray(means, np.float32)
    colors = np.array(list(pixels.removeprefix("bayer_"))).reshape(2, 2)
    balanced = kinds * (level[colors == "g"].mean(axis=0) / np.maximum(level, MIN_LEVEL))
    gray = balanced.transpose(2, 0, 3, 1).reshape(even.shape)[:height, :width]
    return np.asarray(np.clip(np.rint(gray), 0, 255), np.uint8)
