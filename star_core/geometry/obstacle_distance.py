"""How far points are from obstacles."""

from __future__ import annotations

import numpy as np

from star_core.messages.arrays import Array
from star_core.world import Obstacle


def distance(position: Array, obstacle: Obstacle) -> Array:
    """Return how far points are from an obstacle, 0 inside it.

    Args:
        position: (N, 3) points in the map, m.
        obstacle: An upright prism, or several.

    Returns:
        (N,) m.

    Example:
        >>> pillar = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))
        >>> distance(np.array([[2.0, 0.5, 1.0], [0.5, 0.5, 3.0], [0.5, 0.5, 1.0]]), pillar)
        array([1., 1., 0.])
    """
    foot, top = obstacle.height
    height = np.maximum(0.0, np.maximum(foot - position[:, 2], position[:, 2] - top))
    flat = np.min([_flat(position[:, :2], np.array(p)) for p in obstacle.polygons], axis=0)
    answer: Array = np.hypot(flat, height)
    return answer


def _flat(point: Array, polygon: Array) -> Array:
    """Distance in the plane from (N, 2) points to a (K, 2) polygon, 0 inside: (N,) m."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    edge = b - a  # (K, 2)
    offset = point[:, None] - a[None]  # (N, K, 2), from corner to point
    along = np.clip(np.einsum("nkd,kd->nk", offset, edge) / (edge**2).sum(axis=1), 0.0, 1.0)
    gap = np.linalg.norm(offset - along[..., None] * edge, axis=2).min(axis=1)
    x, y = point[:, :1], point[:, 1:]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(edge[:, 1] == 0, 1.0, edge[:, 1])
    crosses = spans & (x < a[:, 0] + (y - a[:, 1]) / rise * edge[:, 0])
    inside = crosses.sum(axis=1) % 2 == 1
    answer: Array = np.where(inside, 0.0, gap)
    return answer
