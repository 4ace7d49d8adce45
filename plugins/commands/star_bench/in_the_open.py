"""Scenarios without obstacles: circle, disc, crossing and stack."""

from __future__ import annotations

import math
from random import Random
from typing import Final

from star_bench.scenario import Scenario, fence, level
from star_bench.spots import PITCH, between, place, shaken

DISC_PITCH: Final = 0.8  # m, between neighbours in the disc: 0.55 m² per agent
DISC_JITTER: Final = 0.1  # m
ARMS: Final = 4
LAYERS: Final = (0.6, 1.3)
"""Heights of the stack, m: farther apart than the 0.6 m within which `orca` avoids laterally."""

STEP: Final = 0.6  # m, horizontal distance of a start from its stack
COLUMN: Final = 1.0  # m, between stacks


def circle(n: int, rng: Random) -> Scenario:
    """Agents on a circle swap sides through its center: all meet there at once."""
    radius = max(1.0, PITCH / (2 * math.sin(math.pi / max(2, n))))
    angles = [math.tau * i / n for i in range(n)]
    ring = [(radius * math.cos(a), radius * math.sin(a)) for a in angles]
    return level(
        [shaken(spot, rng) for spot in ring],
        [shaken((-x, -y), rng) for x, y in ring],
        about=f"{n} drones on a circle swap sides through its center.",
    )


def disc(n: int, rng: Random) -> Scenario:
    """Agents that fill a disc fly to its opposite point, each through all the others."""
    reach = range(-2 - math.isqrt(2 * n), 3 + math.isqrt(2 * n))
    dx, dy = between(rng, 0, DISC_PITCH), between(rng, 0, DISC_PITCH)
    lattice = [
        ((i + j % 2 / 2) * DISC_PITCH + dx, j * math.sqrt(3) / 2 * DISC_PITCH + dy)
        for i in reach
        for j in reach
    ]
    filled = sorted(lattice, key=lambda spot: math.hypot(*spot))[:n]
    return level(
        [shaken(spot, rng, DISC_JITTER) for spot in filled],
        [shaken((-x, -y), rng, DISC_JITTER) for x, y in filled],
        about=f"{n} drones that fill a disc swap sides.",
    )


def crossing(n: int, rng: Random) -> Scenario:
    """Agents come from four sides and fly straight on: streams cross and meet head on."""
    each = math.ceil(n / ARMS)
    lanes = math.ceil(math.sqrt(each))
    rows = math.ceil(each / lanes)
    mouth = max(1.5, lanes * PITCH / 2 + 1.0)  # m, from the center to the first row
    starts, goals = [], []
    for i in range(n):
        quarter = i % ARMS
        row, aside = place(i // ARMS, lanes)
        ahead = mouth + (rows - 1 - row) * PITCH
        starts.append(shaken(_turned(-mouth - row * PITCH, aside, quarter), rng))
        goals.append(shaken(_turned(ahead, aside, quarter), rng))
    return level(starts, goals, about=f"{n} drones cross from four sides.")


def stack(n: int, rng: Random) -> Scenario:
    """Agents fly above each other, then swap heights and positions: downwash hits the lower ones.

    Pairs climb to different heights on either side of a stack, meet above each other in it, and
    leave it for the other agent's initial position and height.
    """
    starts, tops, first, second = [], [], [], []
    columns = math.ceil(n / len(LAYERS))
    for i in range(n):
        y = (i // 2 - (columns - 1) / 2) * COLUMN
        side, height, other = (-1, *LAYERS) if i % 2 == 0 else (1, *reversed(LAYERS))
        starts.append(shaken((side * STEP, y), rng))
        tops.append(height)
        first.append((*shaken((0.0, y), rng), height))
        second.append((*shaken((-side * STEP, y), rng), other))
    low, high = fence([*starts, *((x, y) for x, y, _ in second)])
    return Scenario(
        about=f"{n} drones, in pairs, fly above each other and swap heights.",
        starts=tuple(starts),
        heights=tuple(tops),
        legs=(tuple(first), tuple(second)),
        low=low,
        high=high,
    )


def _turned(x: float, y: float, quarters: int) -> tuple[float, float]:
    """Rotate a spot about the origin by quarter turns, anticlockwise."""
    for _ in range(quarters):
        x, y = -y, x
    return x, y
