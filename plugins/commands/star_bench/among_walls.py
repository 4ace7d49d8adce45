"""Scenarios with obstacles: corridor, doorway, blocks and polygons."""

from __future__ import annotations

import math
from random import Random
from typing import Any, Final

from star_bench.scenario import CEILING, CLEAR, MARGIN, Scenario, Spot, block, level
from star_bench.spots import PITCH, apart, between, place, scattered, shaken, shuffled

LANES: Final = 3  # lanes in which agents wait before a corridor or a door
LENGTH: Final = 4.0  # m, of the corridor
WALL: Final = 0.2  # m, thickness of the wall with the door
BLOCKS: Final = 3  # in a row
BLOCK: Final = 1.0  # m, side of a block
STREET: Final = 1.6  # m, eight radii of 0.2 m
CORNERS: Final = (3, 6)  # of a polygon, least and greatest number
REACH: Final = (0.3, 0.6)  # m, from a polygon's center to its corners, least and greatest
PASSAGE: Final = 1.0  # m, least distance between polygons


def corridor(n: int, rng: Random, *, width: float = 1.6) -> Scenario:
    """Agents at the two ends of a corridor, `width` m wide, swap ends: they meet head on."""
    rows = math.ceil(math.ceil(n / 2) / LANES)
    mouth = LENGTH / 2 + CLEAR + 0.3
    starts, goals = [], []
    for i in range(n):
        side = -1 if i % 2 == 0 else 1
        row, aside = place(i // 2, LANES)
        starts.append(shaken((side * (mouth + row * PITCH), aside), rng))
        goals.append(shaken((-side * (mouth + (rows - 1 - row) * PITCH), aside), rng))
    far = mouth + (rows - 1) * PITCH + MARGIN
    wide = max(width / 2 + WALL, (LANES - 1) / 2 * PITCH + MARGIN)
    return level(
        starts,
        goals,
        about=f"{n} drones swap the ends of a corridor {width:g} m wide.",
        low=(-far, -wide),
        high=(far, wide),
        obstacles={
            "south": block((-LENGTH / 2, -wide), (LENGTH / 2, -width / 2)),
            "north": block((-LENGTH / 2, width / 2), (LENGTH / 2, wide)),
        },
    )


def doorway(n: int, rng: Random, *, width: float = 1.0) -> Scenario:
    """Agents in one room fly to the next through a door, `width` m wide."""
    rows = math.ceil(n / LANES)
    mouth = WALL / 2 + CLEAR + 0.6
    starts, goals = [], []
    for i in range(n):
        row, aside = place(i, LANES)
        starts.append(shaken((-mouth - row * PITCH, aside), rng))
        goals.append(shaken((mouth + (rows - 1 - row) * PITCH, aside), rng))
    far = mouth + (rows - 1) * PITCH + MARGIN
    wide = max(width / 2 + WALL, (LANES - 1) / 2 * PITCH + MARGIN)
    return level(
        starts,
        goals,
        about=f"{n} drones fly through a door {width:g} m wide.",
        low=(-far, -wide),
        high=(far, wide),
        obstacles={
            "south": block((-WALL / 2, -wide), (WALL / 2, -width / 2)),
            "north": block((-WALL / 2, width / 2), (WALL / 2, wide)),
        },
    )


def blocks(n: int, rng: Random, *, street: float = STREET) -> Scenario:
    """Agents cross a town of square blocks, from west to east and from south to north.

    The streets are `street` m wide. Goals on the other side are assigned at random.
    """
    half = (BLOCKS * BLOCK + (BLOCKS - 1) * street) / 2
    most = int(2 * half / PITCH)  # agents side by side
    edge = half + CLEAR + 0.3
    starts, goals = [], []
    farthest = 0
    for side in (0, 1):  # from the west, from the south
        count = (n + 1 - side) // 2
        lanes = min(most, max(1, count))
        for i, other in enumerate(shuffled(count, rng)):
            (row, lane), (end, far_lane) = divmod(i, lanes), divmod(other, lanes)
            aside, beside = ((2 * lane + 1) / lanes - 1 for lane in (lane, far_lane))
            here = -edge - row * PITCH, half * aside
            there = edge + end * PITCH, half * beside
            starts.append(shaken(here if side == 0 else here[::-1], rng))
            goals.append(shaken(there if side == 0 else there[::-1], rng))
            farthest = max(farthest, row)
    far = edge + farthest * PITCH + MARGIN
    corner = [-half + i * (BLOCK + street) for i in range(BLOCKS)]
    return level(
        starts,
        goals,
        about=f"{n} drones cross a town of blocks with streets {street:g} m wide.",
        low=(-far, -far),
        high=(far, far),
        obstacles={
            f"block {BLOCKS * j + i + 1}": block((x, y), (x + BLOCK, y + BLOCK))
            for j, y in enumerate(corner)
            for i, x in enumerate(corner)
        },
    )


def polygons(n: int, rng: Random) -> Scenario:
    """Agents fly between random spots, among random polygons."""
    number = 4 + n // 4
    half = 2 + 0.4 * math.sqrt(n + number)  # m, half the side of the field
    while (drawn := _drawn(n, number, half, rng)) is None:
        half *= 1.1
    starts, goals, shapes = drawn
    return level(
        starts,
        goals,
        about=f"{n} drones fly anywhere among {number} polygons.",
        low=(-half - MARGIN, -half - MARGIN),
        high=(half + MARGIN, half + MARGIN),
        obstacles={f"polygon {i + 1}": shape for i, shape in enumerate(shapes)},
    )


def _drawn(
    n: int, number: int, half: float, rng: Random
) -> tuple[list[Spot], list[Spot], list[dict[str, Any]]] | None:
    """Draw starts, goals and polygons in a square; None if it is too small for them."""
    most = REACH[1]
    middles = scattered(number, half - most, rng, gap=2 * most + PASSAGE)
    if middles is None:
        return None

    def free(spot: Spot) -> bool:
        return apart(spot, middles, most + CLEAR)

    starts, goals = (scattered(n, half, rng, free=free) for _ in range(2))
    if starts is None or goals is None:
        return None
    return starts, goals, [_polygon(middle, rng) for middle in middles]


def _polygon(middle: Spot, rng: Random) -> dict[str, Any]:
    """Draw a convex polygon around a spot: its corners are on a circle."""
    corners = CORNERS[0] + int((CORNERS[1] + 1 - CORNERS[0]) * rng.random())
    reach, turn = between(rng, *REACH), math.tau * rng.random()
    angles = [turn + math.tau * (i + between(rng, -0.3, 0.3)) / corners for i in range(corners)]
    points = [[middle[0] + reach * math.cos(a), middle[1] + reach * math.sin(a)] for a in angles]
    return {"polygon": points, "height": [0.0, CEILING]}
