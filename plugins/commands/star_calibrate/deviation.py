"""How far a camera's matrix may be off, from how its pictures constrain it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import cv2
import numpy as np

from star_core import Array

PLACED: Final = 6  # numbers that place one board: three of its turn, three of its place
LENS: Final = 8  # numbers that all pictures share: fx, fy, cx, cy, k1, k2, p1, p2
SINGULAR: Final = 1e-12  # strength of a constraint that rounding makes out of none


def deviations(
    points: Array,
    places: Iterable[tuple[Array, Array]],
    matrix: Array,
    distortion: Array,
    error: float,
) -> tuple[float, ...]:
    """Return the deviations of fx, fy, cx and cy, px; infinite where nothing constrains them.

    They are those of linear least squares at the solution, with the boards' places eliminated
    from the normal equations. OpenCV's own leave out what is not
    constrained: they called a focal length good to 0.02 px that was 53 px wrong, by eight pictures
    of a board that was never tilted.

    Args:
        points: (K, 3) the board's corners, m.
        places: Rotation vector and translation of each board, from the board to the camera.
        matrix: (3, 3) of the camera.
        distortion: (5,) k1, k2, p1, p2, k3; k3 is taken for known.
        error: RMS distance of all corners from where they should be, px.
    """
    bys = [
        np.asarray(cv2.projectPoints(points, turn, place, matrix, distortion)[1], np.float64)
        for turn, place in places
    ]
    scale = np.linalg.norm(np.concatenate(bys)[:, PLACED : PLACED + LENS], axis=0)
    normal = np.zeros((LENS, LENS))
    for by in bys:
        basis = np.linalg.qr(by[:, :PLACED]).Q
        shared = by[:, PLACED : PLACED + LENS] / scale
        left = shared - basis @ (basis.T @ shared)
        normal += left.T @ left
    corners = len(bys) * len(points)
    free = 2 * corners - PLACED * len(bys) - LENS
    strength, way = np.linalg.eigh(normal)
    if free <= 0 or strength[0] <= SINGULAR:
        return (float("inf"),) * 4
    spread = ((way**2) / strength).sum(axis=1) / scale**2
    deviation = np.sqrt(corners * error**2 / free * spread)
    return tuple(map(float, deviation[:4]))
