"""The scenarios: circle, disc, crossing and stack in the open; the others among obstacles."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import Any, Final

from star_bench.scenario import (
    CEILING,
    MARGIN,
    MIN_CLEARANCE,
    PITCH,
    PointXY,
    Scenario,
    block,
    fence,
    grid_slot,
    jittered,
    level,
    permutation,
    random_points,
    separated,
    uniform,
)
from star_core import InputError

DISC_PITCH: Final = 0.8  # m, between neighbours in the disc: 0.55 m² per agent
DISC_JITTER: Final = 0.1  # m
ARMS: Final = 4  # of the crossing
STACK_HEIGHTS: Final = (0.6, 1.3)
"""m, farther apart than the 0.6 m within which `orca` avoids laterally."""
STACK_START: Final = 0.6  # m, horizontal distance of a start from its stack
STACK_PITCH: Final = 1.0  # m, between stacks
LANES: Final = 3  # in which agents wait before a corridor or a door
CORRIDOR_LENGTH: Final = 4.0  # m
CORRIDOR_QUEUE: Final = MIN_CLEARANCE + 0.3  # m, from the first row of agents to the corridor
WALL_THICKNESS: Final = 0.2  # m
DOOR_QUEUE: Final = MIN_CLEARANCE + 0.6  # m, from the first row of agents to the wall
BLOCKS: Final = 3  # in a row
BLOCK_SIDE: Final = 1.0  # m
STREET: Final = 1.6  # m, eight radii of 0.2 m
CORNERS: Final = (3, 6)  # of a polygon, least and greatest number
POLYGON_RADIUS: Final = (0.3, 0.6)  # m, from a polygon's center to its corners
POLYGON_SEPARATION: Final = 1.0  # m, least distance between polygons


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


def corridor(n: int, rng: Random, *, width: float = 1.6) -> Scenario:
    """Agents at the two ends of a corridor, `width` m wide, swap ends: they meet head on."""
    sides = [-1 if i % 2 == 0 else 1 for i in range(n)]
    slots = [grid_slot(i // 2, LANES) for i in range(n)]
    about = f"{n} drones swap the ends of a corridor {width:g} m wide."
    return _passage(sides, slots, rng, about, width, CORRIDOR_LENGTH, CORRIDOR_QUEUE)


def doorway(n: int, rng: Random, *, width: float = 1.0) -> Scenario:
    """Agents in one room fly to the next through a door, `width` m wide."""
    slots = [grid_slot(i, LANES) for i in range(n)]
    about = f"{n} drones fly through a door {width:g} m wide."
    return _passage([-1] * n, slots, rng, about, width, WALL_THICKNESS, DOOR_QUEUE)


def _passage(
    sides: Sequence[int],
    slots: Sequence[tuple[int, float]],
    rng: Random,
    about: str,
    width: float,
    length: float,
    queue: float,
) -> Scenario:
    """Return agents in front of a passage, on either side, that fly through it to the other.

    Args:
        sides: Side of each agent: -1 west, 1 east.
        slots: Row and lateral offset, m, of each agent.
        rng: Random number generator.
        about: Description.
        width: Of the passage, m.
        length: Of the passage, m.
        queue: Distance of the first row from it, m.
    """
    rows = 1 + max(row for row, _ in slots)
    entry = length / 2 + queue
    starts, goals = [], []
    for side, (row, offset) in zip(sides, slots, strict=True):
        starts.append(jittered((side * (entry + row * PITCH), offset), rng))
        goals.append(jittered((-side * (entry + (rows - 1 - row) * PITCH), offset), rng))
    far = entry + (rows - 1) * PITCH + MARGIN
    wide = max(width / 2 + WALL_THICKNESS, (LANES - 1) / 2 * PITCH + MARGIN)
    return level(
        starts,
        goals,
        about=about,
        low=(-far, -wide),
        high=(far, wide),
        obstacles={
            "south": block((-length / 2, -wide), (length / 2, -width / 2)),
            "north": block((-length / 2, width / 2), (length / 2, wide)),
        },
    )


def blocks(n: int, rng: Random, *, street: float = STREET) -> Scenario:
    """Agents cross a town of square blocks, from west to east and from south to north.

    The streets are `street` m wide. Goals on the other side are assigned at random.
    """
    half = (BLOCKS * BLOCK_SIDE + (BLOCKS - 1) * street) / 2
    most = int(2 * half / PITCH)  # agents side by side
    edge = half + MIN_CLEARANCE + 0.3
    starts, goals = [], []
    last_row = 0
    for side in (0, 1):  # from the west, from the south
        count = (n + 1 - side) // 2
        lanes = min(most, max(1, count))
        for i, other in enumerate(permutation(count, rng)):
            (row, lane), (goal_row, goal_lane) = divmod(i, lanes), divmod(other, lanes)
            start = -edge - row * PITCH, half * ((2 * lane + 1) / lanes - 1)
            goal = edge + goal_row * PITCH, half * ((2 * goal_lane + 1) / lanes - 1)
            starts.append(jittered(start if side == 0 else start[::-1], rng))
            goals.append(jittered(goal if side == 0 else goal[::-1], rng))
            last_row = max(last_row, row)
    far = edge + last_row * PITCH + MARGIN
    corner = [-half + i * (BLOCK_SIDE + street) for i in range(BLOCKS)]
    return level(
        starts,
        goals,
        about=f"{n} drones cross a town of blocks with streets {street:g} m wide.",
        low=(-far, -far),
        high=(far, far),
        obstacles={
            f"block {BLOCKS * j + i + 1}": block((x, y), (x + BLOCK_SIDE, y + BLOCK_SIDE))
            for j, y in enumerate(corner)
            for i, x in enumerate(corner)
        },
    )


def polygons(n: int, rng: Random) -> Scenario:
    """Agents fly between random points, among random polygons."""
    number = 4 + n // 4
    half = 2 + 0.4 * math.sqrt(n + number)  # m, half the side of the field
    while (drawn := _field(n, number, half, rng)) is None:
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


def _field(
    n: int, number: int, half: float, rng: Random
) -> tuple[list[PointXY], list[PointXY], list[dict[str, Any]]] | None:
    """Draw starts, goals and polygons in a square; None if it is too small for them."""
    radius = POLYGON_RADIUS[1]
    centers = random_points(number, half - radius, rng, separation=2 * radius + POLYGON_SEPARATION)
    if centers is None:
        return None

    def free(point: PointXY) -> bool:
        return separated(point, centers, radius + MIN_CLEARANCE)

    starts, goals = (random_points(n, half, rng, free=free) for _ in range(2))
    if starts is None or goals is None:
        return None
    return starts, goals, [_polygon(center, rng) for center in centers]


def _polygon(center: PointXY, rng: Random) -> dict[str, Any]:
    """Draw a convex polygon around a point: its corners are on a circle."""
    corners = CORNERS[0] + int((CORNERS[1] + 1 - CORNERS[0]) * rng.random())
    radius, turn = uniform(rng, *POLYGON_RADIUS), math.tau * rng.random()
    angles = [turn + math.tau * (i + uniform(rng, -0.3, 0.3)) / corners for i in range(corners)]
    points = [[center[0] + radius * math.cos(a), center[1] + radius * math.sin(a)] for a in angles]
    return {"polygon": points, "height": [0.0, CEILING]}


MIN_AGENTS: Final = 2  # a single one has no other to avoid
MAX_AGENTS: Final = 256  # up to which tests cover the layout
MAX_WIDTH: Final = 10  # m, of a corridor, a door or a street

CATALOGUE: Final[Mapping[str, Callable[..., Scenario]]] = {
    draw.__name__: draw
    for draw in (circle, disc, crossing, stack, corridor, doorway, blocks, polygons)
}
NUMBERS: Final[Mapping[str, tuple[int, ...]]] = {"circle": (4, 8, 16, 32, 64)}
USUAL_NUMBERS: Final = (8, 16, 32)


@dataclass(frozen=True, slots=True)
class Case:
    """One scenario as one mission flies it.

    Attributes:
        scenario: Its name in the catalogue.
        agents: Number of agents.
        seed: Seed of the scenario and of the flight.
        options: Its options, such as the width of a corridor, m.
    """

    scenario: str
    agents: int
    seed: int
    options: Mapping[str, float] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The scenario with its options, for tables: ``corridor width 2``."""
        return " ".join([self.scenario, *(f"{k} {v:g}" for k, v in self.options.items())])

    @property
    def name(self) -> str:
        """Name of the mission and its file: ``corridor-width-1_2-8-0``."""
        return f"{self.title.replace(' ', '-').replace('.', '_')}-{self.agents}-{self.seed}"

    def draw(self) -> Scenario:
        """Return the scenario; equal cases give equal ones, other seeds give other ones."""
        rng = Random(f"{self.scenario} {self.agents} {self.seed}")  # noqa: S311 -- no secret
        return CATALOGUE[self.scenario](self.agents, rng, **self.options)


def numbers(scenario: str) -> tuple[int, ...]:
    """Return the default numbers of agents of a scenario."""
    return NUMBERS.get(scenario, USUAL_NUMBERS)


def checked_options(scenario: str, values: Mapping[str, Any]) -> Mapping[str, float]:
    """Return a scenario's options as numbers.

    Raises:
        InputError: It has no option of that name, or the value is not a valid length.
    """
    names = inspect.getfullargspec(CATALOGUE[scenario]).kwonlyargs
    for name, value in values.items():
        if name not in names:
            expected = f"there is {', '.join(names)}" if names else "it has none"
            wrong = f"--scenarios: {scenario!r} has no option {name!r}; {expected}"
            raise InputError(wrong, "invalid-argument")
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (number and 0 < value <= MAX_WIDTH):
            wrong = f"{value!r}, expected m, more than 0, {MAX_WIDTH} at most"
            raise InputError(f"--scenarios: {scenario} {name}: {wrong}", "out-of-range")
    return {name: float(value) for name, value in values.items()}
