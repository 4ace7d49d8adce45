"""Points at which a path can change its height, so that it finds every way there is."""

from __future__ import annotations

import math

import numpy as np
import shapely

from star_core import Array, Fence
from star_visibility.walls import Block

STEP = 1.0  # m between doors on an outline, at most


def doors(blocks: list[Block], height: tuple[float, float], fence: Fence) -> Array:
    """Return points on the outlines of what can be flown over or under: (D, 2) m.

    The outlines and the fence part the plane into cells in which the same is in the way. Every
    cell between two of which one can change has a door on its edge: where outlines meet each other
    or the fence, and along them. So two cells that share a height are joined by one.

    Args:
        blocks: What is forbidden.
        height: Lowest and highest z to fly at, m.
        fence: Doors are inside of it.
    """
    inside = shapely.box(*fence.low[:2], *fence.high[:2])
    line = [shapely.MultiPolygon(block.ground).boundary for block in blocks]
    passed = [k for k, block in enumerate(blocks) if (block.low, block.high) != height]
    found = [np.empty((0, 2))]
    for k in passed:
        for piece in shapely.get_parts(shapely.intersection(line[k], inside)):
            along = np.linspace(0.0, piece.length, math.ceil(piece.length / STEP) + 1)
            found.append(shapely.get_coordinates(shapely.line_interpolate_point(piece, along)))
    if passed:
        tree = shapely.STRtree(line)
        one, other = tree.query([line[k] for k in passed], predicate="intersects")
        one = np.array(passed)[one]
        pairs = one != other
        lines = np.array(line, object)
        meet = shapely.intersection(lines[one[pairs]], lines[other[pairs]])
        points = shapely.get_coordinates(shapely.intersection(meet, inside))
        found.append(points)
    return np.unique(np.concatenate(found), axis=0)
