"""Triangles and edges of a world, for pages and markers that draw it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product

import numpy as np
import shapely

from star_core.messages.arrays import Array, Rows
from star_core.world.world import Obstacle


def obstacle_meshes(obstacle: Obstacle) -> Iterator[tuple[Array, Rows]]:
    """Yield sides and top of each piece of an obstacle.

    Yields:
        (V, 3) vertices in the map, m, and (F, 3) indices of the vertices of its triangles.

    Example:
        >>> pillar = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))
        >>> [(len(vertices), len(faces)) for vertices, faces in obstacle_meshes(pillar)]
        [(8, 10)]
    """
    bottom, top = obstacle.height
    for polygon in obstacle.polygons:
        n, flat = len(polygon), np.array(polygon, np.float64)
        vertices = np.vstack([np.c_[flat, np.full(n, bottom)], np.c_[flat, np.full(n, top)]])
        following = [*range(1, n), 0]
        faces = [(k, after, n + k) for k, after in enumerate(following)]
        faces += [(after, n + after, n + k) for k, after in enumerate(following)]
        index = {(x, y): n + k for k, (x, y) in enumerate(flat.tolist())}
        for triangle in shapely.constrained_delaunay_triangles(shapely.Polygon(flat)).geoms:
            a, b, c = (index[x, y] for x, y in shapely.get_coordinates(triangle)[:3].tolist())
            faces.append((a, b, c))
        yield vertices, np.array(faces)


def box_edges(low: Sequence[float], high: Sequence[float]) -> Array:
    """Return both ends of each of the twelve edges of a box: (12, 2, 3) m.

    Args:
        low: Least x, y and z, m.
        high: Greatest x, y and z, m.

    Example:
        >>> box_edges((0, 0, 0), (1, 1, 1)).shape
        (12, 2, 3)
    """
    corners = product((0, 1), repeat=3)
    ends = [pair for pair in combinations(corners, 2) if np.sum(np.not_equal(*pair)) == 1]
    edges: Array = np.where(np.array(ends) == 1, np.array(high, np.float64), np.array(low))
    return edges
