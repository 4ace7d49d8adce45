"""Tags as kernels take them: where each lies, and what is printed on it.

Which way up a tag is, is decided here: the tag as OpenCV's ``generateImageMarker`` draws it is what
one reads. Its columns run along the tag's x axis, its rows against the y axis. (The AprilTag
library's own frame is turned by 180° against this.)
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from star_core import Array, Tag, rotation_from_quaternion

MODULES = 8  # of a tag of family 36h11 along one side, its black border included
RIM = 1  # modules of white paper around it
CELLS = MODULES + 2 * RIM
PAPER, INK = 215.0, 30.0  # grey values, chosen
FRAME = 13


def frames(tags: Sequence[Tag]) -> Array:
    """Return where tags lie, (M, 13): centre, x, y and z axes in the map, and the edge, m."""
    table = np.empty((len(tags), FRAME))
    for row, tag in zip(table, tags, strict=True):
        row[:3] = tag.position
        row[3:12] = rotation_from_quaternion(tag.rotation).T.ravel()
        row[12] = tag.size
    return table


def corners(places: Array, share: float = 1.0) -> Array:
    """Return the corners of tags in the map.

    Args:
        places: (M, 13) of `frames`.
        share: Size of the square meant, as a multiple of the black square's.

    Returns:
        (M, 4, 3) bottom left, bottom right, top right and top left as one reads the tag, m.
    """
    half = 0.5 * share * places[:, None, 12:]  # (M, 1, 1)
    across = np.array([-1.0, 1.0, 1.0, -1.0])[:, None]
    up = np.array([-1.0, -1.0, 1.0, 1.0])[:, None]
    centre, x, y = places[:, None, :3], places[:, None, 3:6], places[:, None, 6:9]
    return np.asarray(centre + half * (across * x + up * y))


def prints(tags: Sequence[Tag]) -> Array:
    """Return what is on tags and their rims, (M, CELLS, CELLS) grey values, top row first."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    table = np.full((len(tags), CELLS, CELLS), PAPER)
    for cells, tag in zip(table, tags, strict=True):
        bits = cv2.aruco.generateImageMarker(family, tag.id, MODULES)
        cells[RIM:-RIM, RIM:-RIM] = np.where(bits > 0, PAPER, INK)
    return table
