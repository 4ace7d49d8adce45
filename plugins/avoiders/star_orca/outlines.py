"""The outlines of a world's obstacles at every height, as the kernel reads them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from star_core import Array, Rows, World

if TYPE_CHECKING:
    from star_core import Obstacle

# Columns of `Outlines.edges`. The solid lies left of the edge, which leads from A to B.
AX, AY, BX, BY = range(4)
LENGTH, UX, UY = range(4, 7)  # m, and the unit vector along the edge
BEFORE_X, BEFORE_Y, AFTER_X, AFTER_Y = range(7, 11)  # unit vectors of the edges before and after
A_JUTS, B_JUTS = range(11, 13)  # 1 where the solid's corner is less than 180 degrees, else 0
COLUMNS = 13

# A drone's half height, 1.5 cm, and three deviations of an estimate that is good to 3 cm, rounded.
MARGIN = 0.1  # m, nearer than this over or under an obstacle counts as beside it
SHORTEST = 1e-6  # m; shorter edges have no direction worth the name


class Outlines(NamedTuple):
    """Edges by layers of height: between two heights at which anything begins or ends, one layer.

    Attributes:
        edges: (E, 13) edges with the columns named above, those of one layer together.
        first: (L + 1,) first edge of each layer, from the lowest up; those of layer *l* are
            ``edges[first[l]:first[l + 1]]``.
        height: (L - 1,) height at which each layer but the lowest begins, m.
    """

    edges: Array
    first: Rows
    height: Array


def outlines(world: World) -> Outlines:
    """Return the outlines of what stands in the world at every height.

    Pieces that overlap or touch are one solid; the rooms inside are kept, their edges led round
    the other way. Where it is of one height, the world has three layers, of which one has edges.
    """
    spans = [
        (obstacle.height[0] - MARGIN, obstacle.height[1] + MARGIN) for obstacle in world.obstacles
    ]
    height = sorted({z for span in spans for z in span})
    rows: list[tuple[float, ...]] = []
    first = [0, 0]  # nothing is lower than the lowest height
    for low, high in pairwise(height):
        inside = (
            obstacle
            for obstacle, (foot, top) in zip(world.obstacles, spans, strict=True)
            if foot <= low and high <= top
        )
        rows.extend(_edges(inside))
        first.append(len(rows))
    if height:
        first.append(len(rows))  # nor higher than the highest
    return Outlines(
        np.array(rows, np.float64).reshape(-1, COLUMNS),
        np.array(first, np.int64),
        np.array(height, np.float64),
    )


def _edges(obstacles: Iterable[Obstacle]) -> Iterator[tuple[float, ...]]:
    """Yield the edges round everything that some obstacles cover together."""
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
    """Yield the edges of one closed line, (K, 2) corners, m."""
    along = np.roll(corner, -1, axis=0) - corner
    length = np.hypot(along[:, 0], along[:, 1])
    unit = along / length[:, None]
    before, after = np.roll(unit, 1, axis=0), np.roll(unit, -1, axis=0)
    juts = (before[:, 0] * unit[:, 1] - before[:, 1] * unit[:, 0] >= 0.0).astype(np.float64)
    ends = np.roll(corner, -1, axis=0)
    both = np.stack([juts, np.roll(juts, -1)], axis=1)
    table = np.concatenate([corner, ends, length[:, None], unit, before, after, both], axis=1)
    yield from map(tuple, table.tolist())
