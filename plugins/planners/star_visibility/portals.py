"""Points at which a path can change its height, so that every possible path is found."""

from __future__ import annotations

import math

import numpy as np
import shapely

from star_core import Array, Fence
from star_visibility.regions import Block

STEP = 1.0  # m, greatest distance between portals on an outline


def portals(blocks: list[Block], height: tuple[float, float], fence: Fence) -> Array:
    """Return points on the outlines of what agents can fly over or under: (D, 2) m.

    The outlines and the fence divide the plane into cells with the same obstacles. Two adjacent
    cells between which an agent can cross share a portal on their border: where outlines intersect
    each other or the fence, and along them. So two cells that share a free height are connected.

    Args:
        blocks: Forbidden regions.
        height: Lowest and highest flight height z, m.
        fence: Portals are inside it.
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
