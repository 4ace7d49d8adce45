"""Shapes of obstacles: footprints with a clearance, for planners, and meshes, for viewers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, product
from typing import TYPE_CHECKING, Final

import numpy as np

from star_core.messages.arrays import Array, Rows
from star_core.world.world import Obstacle

if TYPE_CHECKING:
    from shapely import MultiPolygon

CHORDS: Final = 4  # of a quarter circle around a corner
OFFSET_RATIO: Final = 1 / math.cos(math.pi / (4 * CHORDS))
"""Offset over clearance such that the chords are no nearer than the clearance: 2 % more."""
TOLERANCE: Final = 1e-9  # m; a corner nearer than this to the line between its neighbors is removed


def footprint(
    obstacles: Iterable[Obstacle], low: float, high: float, clearance: float = 0.0
) -> MultiPolygon:
    """Return the area that agents must avoid between two heights, in the map's x-y plane.

    It is the union of the obstacles between the heights and of everything nearer to them than the
    clearance. Pieces that touch or overlap are merged; the inside of a closed wall is a hole.

    Corners are rounded, not mitered: a miter keeps an agent 1.4 clearances from a right angle, and
    farther the sharper the corner, which closes gaps that are wide enough. The arcs are polygons
    around the true ones: nothing nearer than the clearance is excluded, and nothing farther
    than 1.02 clearances is included (`OFFSET_RATIO`).

    Args:
        obstacles: Upright prisms.
        low: Lower end of the heights, m.
        high: Upper end of the heights, m; equal to `low` for a slice. An obstacle that ends at
            `low` or begins at `high` does not count.
        clearance: In the plane, m.

    Example:
        >>> pillar = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))
        >>> footprint([pillar], 1.0, 1.0).bounds
        (0.0, 0.0, 1.0, 1.0)
        >>> footprint([pillar], 2.0, 2.5, clearance=0.2).is_empty
        True
    """
    import shapely

    pieces = [
        shapely.Polygon(polygon)
        for obstacle in obstacles
        if obstacle.height[0] < high and low < obstacle.height[1]
        for polygon in obstacle.polygons
    ]
    # A wall thinner than the resolution of floats stays a line: no obstacle is lost.
    covered = shapely.union_all([shapely.make_valid(piece) for piece in pieces])
    if clearance > 0:
        covered = shapely.buffer(covered, OFFSET_RATIO * clearance, quad_segs=CHORDS)
    covered = shapely.simplify(covered, TOLERANCE)
    areas = [area for area in shapely.get_parts(covered) if isinstance(area, shapely.Polygon)]
    return shapely.MultiPolygon([area for area in areas if not area.is_empty])


def obstacle_meshes(obstacle: Obstacle) -> Iterator[tuple[Array, Rows]]:
    """Yield sides and top of each piece of an obstacle.

    Yields:
        (V, 3) vertices in the map, m, and (F, 3) indices of the vertices of its triangles.

    Example:
        >>> pillar = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))
        >>> [(len(vertices), len(faces)) for vertices, faces in obstacle_meshes(pillar)]
        [(8, 10)]
    """
    import shapely

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
