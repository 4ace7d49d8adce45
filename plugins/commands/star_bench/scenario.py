"""A scenario: starts, goals and obstacles of a swarm."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

Spot: TypeAlias = tuple[float, float]  # x and y, map frame, m
Point: TypeAlias = tuple[float, float, float]

GAP: Final = 0.5
"""Least distance of two starts, and of two goals, m: two radii of 0.2 m and 0.1 m more."""

CLEAR: Final = 0.5
"""Least distance of starts and goals from obstacles and from the fence, m: space to plan in."""

HEIGHT: Final = 1.0  # m, default height of flights
LOW, HIGH = 0.3, 1.8  # m, the heights to fly at
CEILING: Final = 2.5  # m, of the fence; obstacles reach it, so that agents cannot pass over them
MARGIN: Final = 1.0  # m, between the outermost start or goal and the fence: space to give way


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
    starts: tuple[Spot, ...]
    heights: tuple[float, ...]
    legs: tuple[tuple[Point, ...], ...]
    low: Spot
    high: Spot
    obstacles: Mapping[str, Any] = field(default_factory=dict)

    @property
    def tops(self) -> tuple[Point, ...]:
        """Positions of the agents after the climb."""
        return tuple((*spot, z) for spot, z in zip(self.starts, self.heights, strict=True))

    def straight(self) -> list[list[float]]:
        """Straight distances from each position to the next: one list per leg, of all agents.

        >>> level([(0, 0)], [(3, 4)], about="There.").straight()
        [[5.0]]
        """
        places = (self.tops, *self.legs)
        return [
            [math.dist(a, b) for a, b in zip(before, after, strict=True)]
            for before, after in zip(places, self.legs, strict=False)
        ]


def level(
    starts: Iterable[Spot],
    goals: Iterable[Spot],
    *,
    about: str,
    low: Spot | None = None,
    high: Spot | None = None,
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


def fence(spots: Iterable[Spot], margin: float = MARGIN) -> tuple[Spot, Spot]:
    """Return the bounding box of some spots, enlarged by `margin`, m.

    >>> fence([(0, 0), (2, 1)])
    ((-1.0, -1.0), (3.0, 2.0))
    """
    x, y = zip(*spots, strict=True)
    return (min(x) - margin, min(y) - margin), (max(x) + margin, max(y) + margin)


def block(low: Spot, high: Spot) -> dict[str, Any]:
    """Return a box from floor to ceiling, as in a world file."""
    centre = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    size = [b - a for a, b in zip(low, high, strict=True)]
    return {"box": {"centre": centre, "size": size}, "height": [0.0, CEILING]}
