"""Outlines of the world's obstacles at every height, and the edges that face an agent."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from star_core import Array, Rows, World
from star_core.toolkit import subroutine

if TYPE_CHECKING:
    from star_core import Obstacle


# Columns of `Outlines.edges`. The solid lies left of the edge, which leads from A to B.
AX, AY, BX, BY = range(4)
LENGTH, UX, UY = range(4, 7)  # m, and the unit vector along the edge
BEFORE_X, BEFORE_Y, AFTER_X, AFTER_Y = range(7, 11)  # unit vectors of the edges before and after
A_JUTS, B_JUTS = range(11, 13)  # 1 where the solid's corner is less than 180 degrees, else 0
COLUMNS = 13

# A drone's half height, 1.5 cm, plus three standard deviations of an estimate of 3 cm, rounded.
MARGIN = 0.1  # m: an agent nearer than this above or below an obstacle counts as at its height
SHORTEST = 1e-6  # m: shorter edges have no meaningful direction


class Outlines(NamedTuple):
    """Edges by height layer; a layer lies between two heights at which an obstacle begins or ends.

    Attributes:
        edges: (E, 13) edges with the columns named above, those of one layer together.
        first: (L + 1,) first edge of each layer, from the lowest up; those of layer *l* are
            ``edges[first[l]:first[l + 1]]``.
        height: (L - 1,) lower bound of each layer but the lowest, m.
    """

    edges: Array
    first: Rows
    height: Array


def outlines(world: World) -> Outlines:
    """Return the outlines of the world's obstacles at every height.

    Pieces that overlap or touch are one solid; holes inside it are kept, with their edges in the
    opposite direction. If all obstacles have one height, there are three layers, one with edges.
    """
    spans = [
        (obstacle.height[0] - MARGIN, obstacle.height[1] + MARGIN) for obstacle in world.obstacles
    ]
    height = sorted({z for span in spans for z in span})
    rows: list[tuple[float, ...]] = []
    first = [0, 0]  # the layer below all obstacles is empty
    for low, high in pairwise(height):
        inside = (
            obstacle
            for obstacle, (foot, top) in zip(world.obstacles, spans, strict=True)
            if foot <= low and high <= top
        )
        rows.extend(_edges(inside))
        first.append(len(rows))
    if height:
        first.append(len(rows))  # as is the layer above them
    return Outlines(
        np.array(rows, np.float64).reshape(-1, COLUMNS),
        np.array(first, np.int64),
        np.array(height, np.float64),
    )


def _edges(obstacles: Iterable[Obstacle]) -> Iterator[tuple[float, ...]]:
    """Yield the edges around the union of some obstacles."""
    pieces = [polygon for obstacle in obstacles for polygon in obstacle.polygons]
    if not pieces:
        return
    import shapely

    shapes = [shapely.make_valid(shapely.Polygon(piece)) for piece in pieces]
    whole = shapely.simplify(shapely.union_all(shapes), SHORTEST)
    for part in shapely.get_parts(whole):
        if part.geom_type == "Polygon":
            solid: Any = shapely.orient_polygons(part)  # anticlockwise without, clockwise within
            for ring in (solid.exterior, *solid.interiors):
                yield from _round(shapely.get_coordinates(ring)[:-1])


def _round(corner: Array) -> Iterator[tuple[float, ...]]:
    """Yield the edges of one closed ring, (K, 2) corners, m."""
    along = np.roll(corner, -1, axis=0) - corner
    length = np.hypot(along[:, 0], along[:, 1])
    unit = along / length[:, None]
    before, after = np.roll(unit, 1, axis=0), np.roll(unit, -1, axis=0)
    juts = (before[:, 0] * unit[:, 1] - before[:, 1] * unit[:, 0] >= 0.0).astype(np.float64)
    ends = np.roll(corner, -1, axis=0)
    both = np.stack([juts, np.roll(juts, -1)], axis=1)
    table = np.concatenate([corner, ends, length[:, None], unit, before, after, both], axis=1)
    yield from map(tuple, table.tolist())


@subroutine
def layer_at(z: float, height: Array) -> int:
    """Return the layer of `star_orca.outlines.Outlines` that contains height `z`, m."""
    layer = 0
    while layer < len(height) and z >= height[layer]:
        layer += 1
    return layer


@subroutine
def nearest_edges(
    edges: Array, span: tuple[int, int], x: float, y: float, reach: float, room: tuple[Rows, Array]
) -> int:
    """Find the nearest edges that face a point, nearest first, and return how many there are.

    Args:
        edges: (E, 13) table of `star_orca.outlines.Outlines`.
        span: First edge to search, and one past the last.
        x: Of the point, m.
        y: Of the point, m.
        reach: Search radius, m.
        room: (K,) buffer for the rows of the edges found, and (K,) buffer for their squared
            distances, m². At most K edges are returned.
    """
    nearest, distance = room
    most, count = len(nearest), 0
    limit = reach * reach
    for row in range(span[0], span[1]):
        dx, dy = x - edges[row, AX], y - edges[row, AY]
        off = edges[row, UY] * dx - edges[row, UX] * dy  # how far right of the edge: outside
        if off < 0.0 or off * off >= limit:
            continue
        along = edges[row, UX] * dx + edges[row, UY] * dy
        beyond = along - min(max(along, 0.0), edges[row, LENGTH])
        squared = off * off + beyond * beyond
        if squared >= limit:
            continue
        index = count if count < most else most - 1
        while index > 0 and squared < distance[index - 1]:
            distance[index], nearest[index] = distance[index - 1], nearest[index - 1]
            index -= 1
        distance[index], nearest[index] = squared, row
        if count < most:
            count += 1
        if count == most:
            limit = distance[most - 1]
    return count


@subroutine
def nearest_on(edges: Array, row: int, x: float, y: float) -> tuple[float, float]:
    """Return the vector from a point to the nearest point of an edge, m."""
    dx, dy = x - edges[row, AX], y - edges[row, AY]
    along = edges[row, UX] * dx + edges[row, UY] * dy
    along = min(max(along, 0.0), edges[row, LENGTH])
    return along * edges[row, UX] - dx, along * edges[row, UY] - dy
