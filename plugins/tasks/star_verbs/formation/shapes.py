"""The positions of a formation, and whether agents can fly there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final

from star_verbs.positions import Point, points_between, shifted

if TYPE_CHECKING:
    from star_core import Scene

Offset = Sequence[float]

ORIGIN: Final = (0.0, 0.0, 0.0)
CHECK_STEP: Final = 0.05  # m between checked positions: less than half a Crazyflie's span


@dataclass(frozen=True, slots=True)
class Shape:
    """Positions of a formation, which may move as a whole.

    Attributes:
        position: Positions for agents, map frame, m; at least as many as there are agents.
        min_distance: Least distance between two positions, m; infinite if there are no two.
        move: Displacement of the formation once it is formed, m; zero if it stays.
    """

    position: tuple[Point, ...]
    min_distance: float
    move: Point

    @property
    def move_distance(self) -> float:
        """Distance that the formation moves, m."""
        return math.hypot(*self.move)

    def passed(self, position: Point) -> Iterator[Point]:
        """Yield points that a position passes as the formation moves, up to `CHECK_STEP` apart."""
        if any(self.move):
            _start, *others = points_between(position, shifted(position, self.move), CHECK_STEP)
            yield from others


def shape(agents: int, options: Mapping[str, Any]) -> Shape:
    """Return the positions of a formation for a number of agents.

    Args:
        agents: Number of agents.
        options: Checked options of the verb.

    Example:
        >>> shape(3, {"shape": "line", "centre": [1, 0, 0.8], "spacing": 0.5}).position
        ((0.5, 0.0, 0.8), (1.0, 0.0, 0.8), (1.5, 0.0, 0.8))
    """
    offset = _offsets(agents, options)
    yaw = math.radians(options.get("yaw_deg", 0.0))
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y, z = (float(value) for value in options.get("centre", ORIGIN))
    position = tuple((x + cos * u - sin * v, y + sin * u + cos * v, z + w) for u, v, w in offset)
    to = options["move"]["to"] if "move" in options else (x, y, z)
    # Neighbours in a named shape are consecutive.
    pairs = combinations(offset, 2) if options["shape"] == "points" else [offset[:2]]
    distances = (math.dist(*pair) for pair in pairs if len(offset) > 1)
    return Shape(position, min(distances, default=math.inf), (to[0] - x, to[1] - y, to[2] - z))


def grid_size(agents: int, options: Mapping[str, Any]) -> tuple[int, int]:
    """Return the number of rows and columns of a grid: as given, or as square as possible.

    >>> grid_size(5, {}), grid_size(5, {"rows": 1})
    ((2, 3), (1, 5))
    """
    rows = options.get("rows")
    columns = options.get("columns") or math.ceil(agents / rows if rows else math.sqrt(agents))
    return rows or math.ceil(agents / columns), columns


def position_faults(scene: Scene, figure: Shape) -> Iterator[str]:
    """Report positions that are not flyable, initially or on the way, and why."""
    count = len(figure.position)
    for number, position in enumerate(figure.position, start=1):
        if fault := scene.position_fault(position):
            yield f"position {number} of {count}: {fault}"
    yield from move_faults(scene, figure)


def move_faults(scene: Scene, figure: Shape) -> Iterator[str]:
    """Report positions that pass a point that is not flyable, where, and why."""
    for number, position in enumerate(figure.position, start=1):
        for point in figure.passed(position):
            if fault := scene.position_fault(point):
                yield f"position {number} of {len(figure.position)} moves there: {fault}"
                break


def _offsets(agents: int, options: Mapping[str, Any]) -> list[Offset]:
    """Return the offsets of the positions from the center before rotation, m."""
    match options["shape"]:
        case "points":
            return list(options["points"])
        case "circle":
            radius = options.get("radius")
            if radius is None:  # neighbours are one spacing apart
                chord = 2 * math.sin(math.pi / agents)
                radius = options["spacing"] / chord if agents > 1 else 0.0
            turns = [math.tau * i / agents for i in range(agents)]
            return [(radius * math.cos(turn), radius * math.sin(turn), 0.0) for turn in turns]
        case "line":
            rows, columns = 1, agents
        case _:
            rows, columns = grid_size(agents, options)
    spacing = options["spacing"]
    return [
        (spacing * (column - (columns - 1) / 2), spacing * ((rows - 1) / 2 - row), 0.0)
        for row in range(rows)
        for column in range(columns)
    ]
