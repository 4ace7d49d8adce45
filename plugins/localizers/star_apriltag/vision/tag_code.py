"""Reads the codes of tags of family 36h11 within quadrilaterals of an image."""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from star_apriltag.vision.tag_poses import CELLS, MODULES
from star_core import Array, Image, Rows

Floats = NDArray[np.float32]

MIN_RING_CONTRAST: Final = 10.0  # gray values from a tag's border to the paper around it

SHARPENING: Final = 0.5
"""Of the Laplacian over neighboring modules, which is subtracted: lens and pixels blur modules that
are hardly wider than a pixel. As in the AprilTag library, which uses 0.25 and decides bit by
bit."""

MIN_CORRELATION: Final = 0.82
"""Between the modules of a quadrilateral and the code of a tag. In 2700 other quadrilaterals with
patterns, borders and paper of tags none has more than 0.76 with any of the codes."""

MAX_MODULE: Final = 1.5
"""Brightness at which a module is clipped, where paper is 1 and ink -1: a reflection on one module
counts no more than a module."""

MIN_SPREAD: Final = 2.0  # root of the sum of squares of the modules' deviations from their mean


class Codes(NamedTuple):
    """The codes read in K quadrilaterals."""

    tag: Rows  # (K,) numbers
    turns: Rows  # (K,) quarter turns, anticlockwise in the image, by which tags are turned
    correlation: Array  # (K,) with these codes


def module_grid(image: Image, quads: Array) -> Floats:
    """Return the gray values in the middles of a tag's modules, (K, CELLS, CELLS).

    Args:
        image: Of any size.
        quads: (K, 4, 2) corners of the black squares, px, anticlockwise in the image; the first is
            the bottom left one of the grid, which includes the paper around the square.
    """
    if not len(quads):
        return np.zeros((0, CELLS, CELLS), np.float32)
    corners = np.ascontiguousarray(quads, np.float32)
    maps = [cv2.getPerspectiveTransform(_SQUARE, quad) for quad in corners]
    points = np.concatenate([cv2.perspectiveTransform(_MIDDLES, transform) for transform in maps])
    u, v = cv2.split(points)
    gray = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(gray, np.float32).reshape(-1, CELLS, CELLS)


def bordered(grid: Floats) -> NDArray[np.bool_]:
    """Return which of (K, CELLS, CELLS) grids are dark along the border of a tag."""
    contrast = grid[:, _PAPER].mean(axis=1) - grid[:, _INK].mean(axis=1)
    return np.asarray(contrast >= MIN_RING_CONTRAST)


def read_codes(grid: Floats) -> Codes:
    """Return the codes that are most similar to (K, CELLS, CELLS) gray values of modules.

    Paper and ink are modeled as planes, fitted to the paper around the tag and to its border, so
    that shadows and vignetting do not matter. The modules are sharpened and correlated with all
    codes in four directions: a module in doubt counts less than a clear one.
    """
    flat = grid.reshape(-1, CELLS**2)
    paper, ink = (flat[:, ring.ravel()] @ _fit(name) for name, ring in _RINGS.items())
    bright = (flat - ink) / np.maximum(paper - ink, 1.0) * 2 - 1
    bright = bright.reshape(grid.shape)
    center = bright[:, 2:-2, 2:-2]
    around = bright[:, 1:-3, 2:-2] + bright[:, 3:-1, 2:-2]
    around = around + bright[:, 2:-2, 1:-3] + bright[:, 2:-2, 3:-1]
    sharp = center + np.float32(SHARPENING) * (4 * center - around)
    modules = np.clip(sharp, -MAX_MODULE, MAX_MODULE).reshape(-1, (MODULES - 2) ** 2)
    modules = modules - modules.mean(axis=1, keepdims=True)
    spread = np.linalg.norm(modules, axis=1, keepdims=True)
    similar = modules / np.maximum(spread, MIN_SPREAD) @ _patterns()
    best = similar.argmax(axis=1)
    return Codes(best // 4, best % 4, similar[np.arange(len(grid)), best].astype(np.float64))


@cache
def _patterns() -> Floats:
    """Return the codes in four directions, (36, 4 * 587), each of mean 0 and norm 1."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    images = [
        cv2.aruco.generateImageMarker(family, tag, MODULES) for tag in range(len(family.bytesList))
    ]
    bits = (np.array(images)[:, 1:-1, 1:-1] > 0).astype(np.float32)
    turned = np.stack([np.rot90(bits, turns, axes=(1, 2)) for turns in range(4)], axis=1)
    rows = turned.reshape(-1, bits[0].size)
    rows = rows - rows.mean(axis=1, keepdims=True)
    return np.ascontiguousarray((rows / np.linalg.norm(rows, axis=1, keepdims=True)).T)


@cache
def _fit(name: str) -> Floats:
    """Return the matrix from gray values on a ring to the plane through them on the whole grid."""
    row, column = np.indices((CELLS, CELLS)) - (CELLS - 1) / 2
    plane = np.stack([column, row, np.ones_like(row)], axis=-1)
    matrix = plane.reshape(-1, 3) @ np.linalg.pinv(plane[_RINGS[name]])
    return np.ascontiguousarray(matrix.T, np.float32)


def _ring(inner: int) -> NDArray[np.bool_]:
    """Return the outermost ring of the grid but `inner`, as a mask."""
    depth = np.minimum(np.arange(CELLS), np.arange(CELLS)[::-1])
    return np.asarray(np.minimum(depth[:, None], depth) == inner)


_PAPER, _INK = _ring(0), _ring(1)
_RINGS: Final = {"paper": _PAPER, "ink": _INK}
_SQUARE = np.array([[0, MODULES], [MODULES, MODULES], [MODULES, 0], [0, 0]], np.float32)
_MIDDLES = (
    np.stack(np.meshgrid(np.arange(CELLS) - 0.5, np.arange(CELLS) - 0.5), axis=-1)
    .reshape(1, -1, 2)
    .astype(np.float32)
)
