"""Rays of points in a camera's frame, and by how much they change with the points."""

from __future__ import annotations

import numpy as np

from star_core import Array

_ROWS, _LAST_ROW = np.eye(3)[:2], np.eye(3)[2]


def perspective(points: Array) -> tuple[Array, Array]:
    """Return the rays of points in a camera's frame, and their derivatives by the points.

    Args:
        points: (..., 3) m, in front of the camera.

    Returns:
        (..., 2) rays and (..., 2, 3) derivatives, 1/m.

    Example:
        >>> ray, derivative = perspective(np.array([1.0, 2.0, 4.0]))
        >>> ray, derivative
        (array([0.25, 0.5 ]), array([[ 0.25  ,  0.    , -0.0625],
               [ 0.    ,  0.25  , -0.125 ]]))
    """
    depth = points[..., 2:]
    ray = points[..., :2] / depth
    derivative: Array = (_ROWS - ray[..., None] * _LAST_ROW) / depth[..., None]
    return ray, derivative
