"""The ground that obstacles take at a height with a clearance: what planners plan around."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import shapely
from shapely import MultiPolygon, Polygon

from star_core.world.world import Obstacle

STEPS: Final = 4
"""Chords of a quarter of a circle around a corner."""

OVER: Final = 1 / math.cos(math.pi / (4 * STEPS))
"""A clearance times this is the offset whose chords are no nearer than the clearance: 2 % more."""

STRAIGHT: Final = 1e-9
"""m; a corner nearer than this to the line past it is left out."""


def footprint(
    obstacles: Iterable[Obstacle], low: float, high: float, clearance: float = 0.0
) -> MultiPolygon:
    """Return where no agent may be at heights between `low` and `high`, in the map's x-y plane.

    It is what the obstacles that reach in between cover, and everything nearer to that than the
    clearance. Pieces that touch or overlap are one; what a closed wall surrounds is a hole.

    Corners are rounded, not mitred: a mitre keeps an agent 1.4 clearances from a right angle, and
    farther the sharper the corner, which closes gaps that are wide enough. The arcs are polygons
    around the true ones: nothing nearer than the clearance is left out, and nothing farther
    than 1.02 clearances is taken in (`OVER`).

    Args:
        obstacles: Upright prisms.
        low: Lower end of the heights, m.
        high: Upper end of the heights, m; equal to `low` for a slice. An obstacle that ends at the
            one or begins at the other does not reach in between.
        clearance: Distance to keep in the plane, m.

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
    # A wall thinner than floats can tell is a line, and stays one: no obstacle is lost.
    covered = shapely.union_all([shapely.make_valid(piece) for piece in pieces])
    if clearance > 0:
        covered = shapely.buffer(covered, OVER * clearance, quad_segs=STEPS)
    covered = shapely.simplify(covered, STRAIGHT)
    parts = [part for part in shapely.get_parts(covered) if isinstance(part, Polygon)]
    return MultiPolygon([part for part in parts if not part.is_empty])
