"""A scenario: where a swarm starts, where it goes, and what is in the way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

Spot: TypeAlias = tuple[float, float]  # x and y, map frame, m
Point: TypeAlias = tuple[float, float, float]

GAP: Final = 0.5
"""Least distance of two starts, and of two goals, m: two radii of 0.2 m and a quarter more."""

CLEAR: Final = 0.5
"""Least distance of starts and goals from obstacles and from the fence, m: room to plan in."""

HEIGHT: Final = 1.0  # m, at which everybody flies if nothing else is said
LOW, HIGH = 0.3, 1.8  # m, the heights to fly at
CEILING: Final = 2.5  # m, of the fence; obstacles reach it, so that nobody flies over them
MARGIN: Final = 1.0  # m, between the outermost start or goal and the fence: room to give way


@dataclass(frozen=True, slots=True)
class Scenario:
    """What is flown, but for who flies it how.

    Attributes:
        about: One sentence.
        starts: Where each agent stands, on the floor.
        heights: To which each climbs first, m.
        legs: Where each flies then; one leg begins when everybody has ended the one before.
        low: Least x and y of the fence.
        high: Greatest x and y of the fence.
        obstacles: As a world file has them, by name.
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
        """Where the agents are when they have climbed."""
        return tuple((*spot, z) for spot, z in zip(self.starts, self.heights, strict=True))

    def straight(self) -> list[list[float]]:
        """How far it is straight from each place to the next: one list a leg, a number an agent.

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
    """Return a scenario of one leg at `HEIGHT`, fenced with `MARGIN` if nothing else is said."""
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
    """Return the least and the greatest x and y of some spots, `margin` farther out, m.

    >>> fence([(0, 0), (2, 1)])
    ((-1.0, -1.0), (3.0, 2.0))
    """
    x, y = zip(*spots, strict=True)
    return (min(x) - margin, min(y) - margin), (max(x) + margin, max(y) + margin)


def block(low: Spot, high: Spot) -> dict[str, Any]:
    """Return a box from floor to ceiling, as a world file has it."""
    centre = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    size = [b - a for a, b in zip(low, high, strict=True)]
    return {"box": {"centre": centre, "size": size}, "height": [0.0, CEILING]}
