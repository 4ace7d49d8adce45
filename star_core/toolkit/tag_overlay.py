"""Camera images in color, with the tags that were detected in them."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from star_core.messages.telemetry import Detections, Image

USED: Final = (0, 220, 90)  # red, green and blue
REJECTED: Final = (255, 140, 0)


def image_with_tags(image: Image, detections: Detections, width: int) -> Image:
    """Return an image in color with the outlines and numbers of tags, orange if rejected.

    Args:
        image: (height, width) gray values.
        detections: The tags of this image.
        width: Of the result, px.

    Returns:
        (height, width, 3) red, green and blue.
    """
    scale = width / image.shape[1]
    shown = cv2.resize(image, (width, round(image.shape[0] * scale)))
    shown = cv2.cvtColor(shown, cv2.COLOR_GRAY2RGB)
    finite = np.isfinite(detections.corners).all(axis=(1, 2))
    for k in np.flatnonzero(finite).tolist():
        color = REJECTED if detections.rejected[k] else USED
        corners = np.round((detections.corners[k] + 0.5) * scale - 0.5).astype(np.int32)
        cv2.polylines(shown, [corners], isClosed=True, color=color, thickness=2)
        u, v = corners.max(axis=0).tolist()
        for shade, thickness in ((0, 0, 0), 3), (color, 1):
            at, font = (u + 3, v), cv2.FONT_HERSHEY_SIMPLEX
            cv2.putText(shown, str(detections.tag[k]), at, font, 0.5, shade, thickness, cv2.LINE_AA)
    return np.asarray(shown, np.uint8)
