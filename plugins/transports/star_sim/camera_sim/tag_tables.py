"""Tags as arrays for kernels: poses, corners and patterns.

A tag's orientation is that in which OpenCV's ``generateImageMarker`` draws it: columns run along
its x axis, rows against its y axis. (The AprilTag library's frame is rotated by 180°.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from star_core import Array, Tag, rotation_from_quaternion, square_corners

MODULES = 8  # per row of a tag of family 36h11, with its black border
RIM = 1  # modules, width of the white border
CELLS = MODULES + 2 * RIM
PAPER, INK = 215.0, 30.0  # gray values
FRAME = 13


class TagTables(NamedTuple):
    """Tags for the renderer."""

    frames: Array  # (M, 13) of `tag_frames`
    rims: Array  # (M, 4, 3) corners of their white borders in the map, m
    prints: Array  # (M, CELLS, CELLS) patterns with white borders, gray values, top row first


def tag_frames(tags: Sequence[Tag]) -> Array:
    """Return (M, 13): center, x, y and z axes of tags in the map, and their edges, m."""
    table = np.empty((len(tags), FRAME))
    for row, tag in zip(table, tags, strict=True):
        row[:3] = tag.position
        row[3:12] = rotation_from_quaternion(tag.rotation).T.ravel()
        row[12] = tag.size
    return table


def corners(frames: Array, scale: float = 1.0) -> Array:
    """Return the corners of tags in the map, in the order of `star_core.square_corners`.

    Args:
        frames: (M, 13) of `tag_frames`.
        scale: Size of the square, as a multiple of the black square's.

    Returns:
        (M, 4, 3) m.
    """
    x, y = square_corners(scale)[:, :2, None].swapaxes(0, 1)  # (4, 1) each, of a unit tag
    axes = frames[:, 12, None, None] * (x * frames[:, None, 3:6] + y * frames[:, None, 6:9])
    return np.asarray(frames[:, None, :3] + axes)


def prints(tags: Sequence[Tag]) -> Array:
    """Return the patterns of tags with their white borders, (M, CELLS, CELLS) gray values."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    table = np.full((len(tags), CELLS, CELLS), PAPER)
    for cells, tag in zip(table, tags, strict=True):
        bits = cv2.aruco.generateImageMarker(family, tag.id, MODULES)
        cells[RIM:-RIM, RIM:-RIM] = np.where(bits > 0, PAPER, INK)
    return table
