"""Where no agent may be, in bands of heights, as arrays that kernels read."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from star_core import Array, Rows, World, footprint

THIN = 1e-9  # m, less than this between two heights is no band


class Walls(NamedTuple):
    """The outlines of what is forbidden, one set for each band of heights between two levels.

    In one band the same obstacles are in the way at all heights. Below the lowest and above the
    highest level the nearest band goes on.

    Attributes:
        level: (B + 1,) heights between which the bands lie, ascending, m.
        first_ring: (B + 1,) first ring of each band, and one past the last.
        box: (R, 4) least x and y, greatest x and y of each ring, m.
        first_corner: (R + 1,) first corner of each ring, and one past the last.
        corner: (C, 2) corners of the rings, m. What is forbidden lies to the left of the way from
            one to the next.
    """

    level: Array
    first_ring: Rows
    box: Array
    first_corner: Rows
    corner: Array


def walls(
    world: World, height: tuple[float, float], clearance: float, vertical_clearance: float
) -> Walls:
    """Return where no agent may be that keeps a clearance to the obstacles of a world.

    Args:
        world: For its obstacles.
        height: Lowest and highest z to look at, m.
        clearance: Distance to keep beside an obstacle, m.
        vertical_clearance: Distance to keep below and above an obstacle, m.
    """
    level = _levels(world, height, vertical_clearance)
    first_ring, rings = [0], list[Array]()
    for low, high in pairwise(level):
        middle = (low + high) / 2
        ground = footprint(
            world.obstacles, middle - vertical_clearance, middle + vertical_clearance, clearance
        )
        for part in ground.geoms:
            rings += [_ring(line.coords, turn) for line, turn in
                      [(part.exterior, 1), *((hole, -1) for hole in part.interiors)]]  # fmt: skip
        first_ring.append(len(rings))
    box = [np.concatenate([ring.min(axis=0), ring.max(axis=0)]) for ring in rings]
    return Walls(
        np.array(level, np.float64),
        np.array(first_ring),
        np.array(box).reshape(-1, 4),
        np.cumsum([0, *map(len, rings)]),
        np.concatenate([np.empty((0, 2)), *rings]),
    )


def _levels(world: World, height: tuple[float, float], vertical_clearance: float) -> list[float]:
    low, high = height
    between = {
        float(z)
        for obstacle in world.obstacles
        for z in (obstacle.height[0] - vertical_clearance, obstacle.height[1] + vertical_clearance)
        if low + THIN < z < high - THIN
    }
    levels = [low]
    for z in sorted(between):
        if z - levels[-1] > THIN:
            levels.append(z)
    return [*levels, high]


def _ring(coordinates: object, turn: int) -> Array:
    """Corners of a closed line, each once, anticlockwise (1) or clockwise (-1): (K, 2) m."""
    ring = np.array(coordinates, np.float64)[:-1, :2]
    after = np.roll(ring, -1, axis=0)
    area = float((ring[:, 0] * after[:, 1] - after[:, 0] * ring[:, 1]).sum())
    return ring if area * turn > 0 else np.ascontiguousarray(ring[::-1])
