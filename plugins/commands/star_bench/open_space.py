"""Scenarios without obstacles: circle, disc, crossing and stack."""

from __future__ import annotations

import math
from random import Random
from typing import Final

from star_bench.scenario import PITCH, Scenario, fence, grid_slot, jittered, level, uniform

DISC_PITCH: Final = 0.8  # m, between neighbours in the disc: 0.55 m² per agent
DISC_JITTER: Final = 0.1  # m
ARMS: Final = 4  # of the crossing
STACK_HEIGHTS: Final = (0.6, 1.3)
"""m, farther apart than the 0.6 m within which `orca` avoids laterally."""
STACK_START: Final = 0.6  # m, horizontal distance of a start from its stack
STACK_PITCH: Final = 1.0  # m, between stacks


def circle(n: int, rng: Random) -> Scenario:
    """Agents on a circle swap sides through its center: all meet there at once."""
    radius = max(1.0, PITCH / (2 * math.sin(math.pi / max(2, n))))
    angles = [math.tau * i / n for i in range(n)]
    ring = [(radius * math.cos(a), radius * math.sin(a)) for a in angles]
    return level(
        [jittered(point, rng) for point in ring],
        [jittered((-x, -y), rng) for x, y in ring],
        about=f"{n} drones on a circle swap sides through its center.",
    )


def disc(n: int, rng: Random) -> Scenario:
    """Agents that fill a disc fly to its opposite point, each through all the others."""
    reach = range(-2 - math.isqrt(2 * n), 3 + math.isqrt(2 * n))
    dx, dy = uniform(rng, 0, DISC_PITCH), uniform(rng, 0, DISC_PITCH)
    lattice = [
        ((i + j % 2 / 2) * DISC_PITCH + dx, j * math.sqrt(3) / 2 * DISC_PITCH + dy)
        for i in reach
        for j in reach
    ]
    filled = sorted(lattice, key=lambda point: math.hypot(*point))[:n]
    return level(
        [jittered(point, rng, DISC_JITTER) for point in filled],
        [jittered((-x, -y), rng, DISC_JITTER) for x, y in filled],
        about=f"{n} drones that fill a disc swap sides.",
    )


def crossing(n: int, rng: Random) -> Scenario:
    """Agents come from four sides and fly straight on: streams cross and meet head on."""
    each = math.ceil(n / ARMS)
    lanes = math.ceil(math.sqrt(each))
    rows = math.ceil(each / lanes)
    entry = max(1.5, lanes * PITCH / 2 + 1.0)  # m, from the center to the first row
    starts, goals = [], []
    for i in range(n):
        quarter = i % ARMS
        row, offset = grid_slot(i // ARMS, lanes)
        start, goal = (-entry - row * PITCH, offset), (entry + (rows - 1 - row) * PITCH, offset)
        for _ in range(quarter):  # a quarter turn anticlockwise
            start, goal = (-start[1], start[0]), (-goal[1], goal[0])
        starts.append(jittered(start, rng))
        goals.append(jittered(goal, rng))
    return level(starts, goals, about=f"{n} drones cross from four sides.")


def stack(n: int, rng: Random) -> Scenario:
    """Agents fly above each other, then swap heights and positions: downwash hits the lower ones.

    Pairs climb to different heights on either side of a stack, meet above each other in it, and
    leave it for the other agent's initial position and height.
    """
    starts, tops, first, second = [], [], [], []
    stacks = math.ceil(n / len(STACK_HEIGHTS))
    for i in range(n):
        y = (i // 2 - (stacks - 1) / 2) * STACK_PITCH
        side, height, other = (-1, *STACK_HEIGHTS) if i % 2 == 0 else (1, *STACK_HEIGHTS[::-1])
        starts.append(jittered((side * STACK_START, y), rng))
        tops.append(height)
        first.append((*jittered((0.0, y), rng), height))
        second.append((*jittered((-side * STACK_START, y), rng), other))
    low, high = fence([*starts, *((x, y) for x, y, _ in second)])
    about = f"{n} drones, in pairs, fly above each other and swap heights."
    return Scenario(about, tuple(starts), tuple(tops), (tuple(first), tuple(second)), low, high)
