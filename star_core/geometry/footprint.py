"""Footprints of obstacles at a height, with a clearance, for planners."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import shapely
from shapely import MultiPolygon, Polygon

from star_core.world.world import Obstacle

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
    pieces = [
        Polygon(polygon)
        for obstacle in obstacles
        if obstacle.height[0] < high and low < obstacle.height[1]
        for polygon in obstacle.polygons
    ]
    # A wall thinner than the resolution of floats stays a line: no obstacle is lost.
    covered = shapely.union_all([shapely.make_valid(piece) for piece in pieces])
    if clearance > 0:
        covered = shapely.buffer(covered, OFFSET_RATIO * clearance, quad_segs=CHORDS)
    covered = shapely.simplify(covered, TOLERANCE)
    areas = [area for area in shapely.get_parts(covered) if isinstance(area, Polygon)]
    return MultiPolygon([area for area in areas if not area.is_empty])
