"""A scenario: starts, goals and obstacles of a swarm, and how agents are laid out.

Only `random.Random.random` is used: it alone is guaranteed to return the same numbers in every
version of Python, so that a scenario's file is the same everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import Any, Final, TypeAlias

PointXY: TypeAlias = tuple[float, float]  # map frame, m
Point: TypeAlias = tuple[float, float, float]

MIN_SEPARATION: Final = 0.5  # m, of starts and of goals: two radii of 0.2 m and 0.1 m more
MIN_CLEARANCE: Final = 0.5  # m, of starts and goals from obstacles and fence: space to plan in
HEIGHT: Final = 1.0  # m, default height of flights
LOW, HIGH = 0.3, 1.8  # m, the heights to fly at
CEILING: Final = 2.5  # m, of the fence; obstacles reach it, so that agents cannot pass over them
MARGIN: Final = 1.0  # m, between the outermost start or goal and the fence: space to give way
JITTER: Final = 0.05  # m, greatest random displacement of a start or goal
PITCH: Final = 1.0
"""Distance of neighbours before jitter, m. A third agent can pass between two that have arrived,
each with a radius of 0.2 m: otherwise the last one faces a sliding puzzle."""
MAX_DRAWS: Final = 2000  # for one agent, before the area counts as full


@dataclass(frozen=True, slots=True)
class Scenario:
    """Starts, goals and obstacles, independent of plugins.

    Attributes:
        about: Description, one sentence.
        starts: Start of each agent, on the floor.
        heights: Height to which each agent climbs first, m.
        legs: Goals of each agent; one leg begins when all agents have completed the previous one.
        low: Least x and y of the fence.
        high: Greatest x and y of the fence.
        obstacles: Obstacles by name, as in a world file.
    """

    about: str
    starts: tuple[PointXY, ...]
    heights: tuple[float, ...]
    legs: tuple[tuple[Point, ...], ...]
    low: PointXY
    high: PointXY
    obstacles: Mapping[str, Any] = field(default_factory=dict)

    def straight(self) -> list[list[float]]:
        """Straight distances from each position to the next: one list per leg, of all agents.

        >>> level([(0, 0)], [(3, 4)], about="There.").straight()
        [[5.0]]
        """
        tops = tuple((*start, z) for start, z in zip(self.starts, self.heights, strict=True))
        return [
            [math.dist(a, b) for a, b in zip(before, after, strict=True)]
            for before, after in zip((tops, *self.legs), self.legs, strict=False)
        ]


def level(
    starts: Iterable[PointXY],
    goals: Iterable[PointXY],
    *,
    about: str,
    low: PointXY | None = None,
    high: PointXY | None = None,
    obstacles: Mapping[str, Any] | None = None,
) -> Scenario:
    """Return a scenario of one leg at `HEIGHT`, by default fenced with `MARGIN`."""
    starts, goals = tuple(starts), tuple(goals)
    around = fence([*starts, *goals])
    return Scenario(
        about=about,
        starts=starts,
        heights=(HEIGHT,) * len(starts),
        legs=(tuple((x, y, HEIGHT) for x, y in goals),),
        low=around[0] if low is None else low,
        high=around[1] if high is None else high,
        obstacles=obstacles or {},
    )


def fence(points: Iterable[PointXY]) -> tuple[PointXY, PointXY]:
    """Return the bounding box of some points, enlarged by `MARGIN`.

    >>> fence([(0, 0), (2, 1)])
    ((-1.0, -1.0), (3.0, 2.0))
    """
    x, y = zip(*points, strict=True)
    return (min(x) - MARGIN, min(y) - MARGIN), (max(x) + MARGIN, max(y) + MARGIN)


def block(low: PointXY, high: PointXY) -> dict[str, Any]:
    """Return a box from floor to ceiling, as in a world file."""
    centre = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    size = [b - a for a, b in zip(low, high, strict=True)]
    return {"box": {"centre": centre, "size": size}, "height": [0.0, CEILING]}


def uniform(rng: Random, low: float, high: float) -> float:
    """Draw a number from an interval."""
    return low + (high - low) * rng.random()


def jittered(point: PointXY, rng: Random, radius: float = JITTER) -> PointXY:
    """Draw a point in the circle of `radius`, m, around another."""
    angle, away = math.tau * rng.random(), radius * math.sqrt(rng.random())
    return point[0] + away * math.cos(angle), point[1] + away * math.sin(angle)


def grid_slot(index: int, lanes: int) -> tuple[int, float]:
    """Return the row of an agent in rows of `lanes` agents, and its lateral offset, m.

    >>> [grid_slot(i, 3) for i in range(4)]
    [(0, -1.0), (0, 0.0), (0, 1.0), (1, -1.0)]
    """
    row, lane = divmod(index, lanes)
    return row, (lane - (lanes - 1) / 2) * PITCH


def permutation(n: int, rng: Random) -> list[int]:
    """Return the numbers below `n` in random order."""
    keys = [rng.random() for _ in range(n)]
    return sorted(range(n), key=keys.__getitem__)


def random_points(
    n: int,
    half: float,
    rng: Random,
    *,
    separation: float = MIN_SEPARATION,
    free: Callable[[PointXY], bool] = bool,
) -> list[PointXY] | None:
    """Draw points that are `free` and separated in a square around the origin.

    Args:
        n: Number of points.
        half: Half the square's side, m.
        rng: Random number generator.
        separation: Least distance between two points, m.
        free: Whether a point may be used; any may if not given.

    Returns:
        The points, or None if there is no room for so many.
    """
    points: list[PointXY] = []
    for _ in range(n):
        for _ in range(MAX_DRAWS):
            point = uniform(rng, -half, half), uniform(rng, -half, half)
            if free(point) and separated(point, points, separation):
                points.append(point)
                break
        else:
            return None
    return points


def separated(point: PointXY, others: Sequence[PointXY], distance: float) -> bool:
    """Whether a point is at least `distance`, m, from all others."""
    return all(math.dist(point, other) >= distance for other in others)
