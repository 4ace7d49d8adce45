"""The points used by a search: corners and portals, and the free heights at each."""

from __future__ import annotations

import math

import numpy as np
import shapely

from star_core import Array, Fence, Rows
from star_core.toolkit import compiled
from star_visibility.openings import openings
from star_visibility.regions import Block, Regions
from star_visibility.search import Nodes

LEAST = 1e-9  # m; a smaller range of heights counts as empty


def nodes(
    parts: Regions, span: Array, height: tuple[float, float], position: Array, block: Rows
) -> Nodes:
    """Return points and their states.

    Args:
        parts: Blocks.
        span: (G, 2) least and greatest height of each, m.
        height: Lowest and highest flight height z, m.
        position: (P, 2) the points, m.
        block: (P,) block whose corner each point is; -1 for none.
    """
    of, free = columns(parts, span, position, *height)
    come = free.copy()
    at_corner = block[of] >= 0
    block_span = span[block[of[at_corner]]] if at_corner.any() else np.empty((0, 2))
    come[at_corner, 0] = np.maximum(come[at_corner, 0], block_span[:, 0])
    come[at_corner, 1] = np.minimum(come[at_corner, 1], block_span[:, 1])
    use = come[:, 1] - come[:, 0] > LEAST
    of, free, come = of[use], free[use], come[use]
    return Nodes(position, np.searchsorted(of, np.arange(len(position) + 1)), free, come, of)


def joined(some: Nodes, others: Nodes) -> Nodes:
    """Return the points of both tables."""
    count = len(some.position)
    return Nodes(
        np.concatenate([some.position, others.position]),
        np.concatenate([some.first, some.first[-1] + others.first[1:]]),
        np.concatenate([some.open, others.open]),
        np.concatenate([some.come, others.come]),
        np.concatenate([some.of, others.of + count]),
    )


@compiled
def columns(
    parts: Regions, span: Array, position: Array, low: float, high: float
) -> tuple[Rows, Array]:
    """Return the free height ranges at each point: (S,) its row, and (S, 2) the ranges.

    They are in ascending order of rows and heights.
    """
    rows, least, greatest = [0 for _ in range(0)], [0.0 for _ in range(0)], [0.0 for _ in range(0)]
    for i in range(len(position)):
        free = openings(parts, span, position[i], position[i], (low, high), (-1, -1))
        for k in range(len(free)):
            rows.append(i)
            least.append(free[k, 0])
            greatest.append(free[k, 1])
    of, heights = np.empty(len(rows), np.int64), np.empty((len(rows), 2))
    for k in range(len(rows)):
        of[k], heights[k, 0], heights[k, 1] = rows[k], least[k], greatest[k]
    return of, heights


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
    candidates = [np.empty((0, 2))]
    for k in passed:
        for piece in shapely.get_parts(shapely.intersection(line[k], inside)):
            along = np.linspace(0.0, piece.length, math.ceil(piece.length / STEP) + 1)
            candidates.append(shapely.get_coordinates(shapely.line_interpolate_point(piece, along)))
    if passed:
        tree = shapely.STRtree(line)
        first, other = tree.query([line[k] for k in passed], predicate="intersects")
        first = np.array(passed)[first]
        pairs = first != other
        lines = np.array(line, object)
        meet = shapely.intersection(lines[first[pairs]], lines[other[pairs]])
        points = shapely.get_coordinates(shapely.intersection(meet, inside))
        candidates.append(points)
    return np.unique(np.concatenate(candidates), axis=0)
