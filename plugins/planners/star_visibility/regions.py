"""Forbidden regions as arrays for kernels: in height bands, and by block."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from star_core import Array, Obstacle, Rows, World
from star_core.toolkit import footprint

THIN = 1e-9  # m: a smaller height difference is not a band


class Regions(NamedTuple):
    """Outlines of the forbidden regions, one set per band of heights between two levels.

    The forbidden region is the same at all heights of a band. Below the lowest and above the
    highest level the nearest band applies.

    Attributes:
        level: (B + 1,) heights that separate the bands, ascending, m.
        first_ring: (B + 1,) first ring of each band, and one past the last.
        box: (R, 4) least x and y, greatest x and y of each ring, m.
        first_corner: (R + 1,) first corner of each ring, and one past the last.
        corner: (C, 2) corners of the rings, m. The forbidden region lies to the left of the
            direction from one to the next.
    """

    level: Array
    first_ring: Rows
    box: Array
    first_corner: Rows
    corner: Array


class Block(NamedTuple):
    """A region that is forbidden between two heights; regions with equal heights are merged.

    Attributes:
        low: Lower bound, m.
        high: Upper bound, m.
        ground: Its area in the x-y plane, in pieces that do not touch.
        rings: Rings of each piece, (K, 2) m, as in `Regions`.
    """

    low: float
    high: float
    ground: list[shapely.Polygon]
    rings: list[list[Array]]


def blocks(
    world: World, height: tuple[float, float], clearance: float, vertical_clearance: float
) -> list[Block]:
    """Return the regions in which an agent would be nearer to an obstacle than its clearances.

    Args:
        world: World with the obstacles.
        height: Lowest and highest z to consider, m.
        clearance: Horizontal distance to keep to an obstacle, m.
        vertical_clearance: Vertical distance to keep to an obstacle, m.
    """
    low, high = height
    alike: dict[tuple[float, float], list[Obstacle]] = {}
    for obstacle in world.obstacles:
        foot, top = obstacle.height
        begin, end = foot - vertical_clearance, top + vertical_clearance
        if begin < high - THIN and end > low + THIN:
            alike.setdefault((max(begin, low), min(end, high)), []).append(obstacle)
    answer = []
    for ends, some in sorted(alike.items()):
        ground = list(footprint(some, -np.inf, np.inf, clearance).geoms)
        answer.append(Block(*ends, ground, [_rings(piece) for piece in ground]))
    return answer


def regions(parts: list[Block], height: tuple[float, float]) -> Regions:
    """Return forbidden regions in bands; blocks that overlap in a band are merged there.

    Args:
        parts: Forbidden regions.
        height: Lowest and highest z, m.
    """
    level = _levels(parts, height)
    piece = [(part, ground, rings) for part in parts
             for ground, rings in zip(part.ground, part.rings, strict=True)]  # fmt: skip
    crowds = list(_crowds([ground for _, ground, _ in piece]))
    rings_by_group: dict[tuple[int, ...], list[Array]] = {
        (k,): rings for k, (_, _, rings) in enumerate(piece)
    }
    bands = []
    for low, high in pairwise(level):
        middle = (low + high) / 2
        bands.append(list[Array]())
        for crowd in crowds:
            group = tuple(k for k in crowd if piece[k][0].low < middle < piece[k][0].high)
            if group and group not in rings_by_group:
                rings_by_group[group] = _rings(shapely.union_all([piece[k][1] for k in group]))
            bands[-1] += rings_by_group.get(group, ())
    return _tables(np.array(level, np.float64), bands)


def apart(parts: Iterable[Block]) -> Regions:
    """Return the outlines of blocks, each block as if it were a band."""
    return _tables(np.empty(0), [[ring for some in part.rings for ring in some] for part in parts])


def _crowds(ground: list[shapely.Polygon]) -> Iterator[list[int]]:
    """Yield groups of polygons that touch, directly or through others: the rows of each group."""
    if not ground:
        return
    first, other = shapely.STRtree(ground).query(ground, predicate="intersects")
    net: Any = csr_array((np.ones(len(first)), (first, other)), shape=(len(ground),) * 2)
    count, label = connected_components(net, directed=False)
    for crowd in range(count):
        yield np.flatnonzero(label == crowd).tolist()


def _tables(level: Array, bands: Iterable[list[Array]]) -> Regions:
    first_ring, rings = [0], list[Array]()
    for some in bands:
        rings += some
        first_ring.append(len(rings))
    first_corner = np.cumsum([0, *map(len, rings)])
    corner = np.concatenate([np.empty((0, 2)), *rings])
    box = np.empty((len(rings), 4))
    if rings:
        box[:, :2] = np.minimum.reduceat(corner, first_corner[:-1])
        box[:, 2:] = np.maximum.reduceat(corner, first_corner[:-1])
    return Regions(level, np.array(first_ring), box, first_corner, corner)


def _rings(ground: shapely.Geometry) -> list[Array]:
    """The rings of all polygons of a planar geometry."""
    return [
        _ring(line, turn)
        for part in shapely.get_parts(ground)
        if part.geom_type == "Polygon" and not part.is_empty
        for line, turn in [(part.exterior, 1), *((hole, -1) for hole in part.interiors)]
    ]


def _levels(parts: Iterable[Block], height: tuple[float, float]) -> list[float]:
    low, high = height
    between = {z for part in parts for z in (part.low, part.high) if low + THIN < z < high - THIN}
    levels = [low]
    for z in sorted(between):
        if z - levels[-1] > THIN:
            levels.append(z)
    return [*levels, high]


def _ring(line: shapely.LinearRing, turn: int) -> Array:
    """Corners of a closed ring, each once, anticlockwise (1) or clockwise (-1): (K, 2) m."""
    closed = np.asarray(shapely.get_coordinates(line), np.float64)
    (x, y), (next_x, next_y) = closed[:-1].T, closed[1:].T
    ring = closed[:-1]
    return ring if float(x @ next_y - next_x @ y) * turn > 0 else np.ascontiguousarray(ring[::-1])
