"""The positions of a formation. Does not import numpy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

Point = tuple[float, float, float]
Offset = Sequence[float]

SPACING: Final = 0.6
"""Default distance between neighbours, m."""

ORIGIN: Final = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Shape:
    """Positions of a formation, which may move as a whole.

    Attributes:
        place: Positions for agents, map frame, m; at least as many as there are agents.
        apart: Least distance between two positions, m; infinite if there are no two.
        move: Displacement of the formation once it is formed, m; zero if it stays.
    """

    place: tuple[Point, ...]
    apart: float
    move: Point

    @property
    def way(self) -> float:
        """Distance that the formation moves, m."""
        return math.hypot(*self.move)


def shape(agents: int, options: Mapping[str, Any]) -> Shape:
    """Return the positions of a formation for a number of agents.

    Args:
        agents: Number of agents.
        options: Checked options of the verb.

    Example:
        >>> shape(3, {"shape": "line", "centre": [1, 0, 0.8], "spacing": 0.5}).place
        ((0.5, 0.0, 0.8), (1.0, 0.0, 0.8), (1.5, 0.0, 0.8))
    """
    offset = OFFSETS[options["shape"]](agents, options)
    turn = math.radians(options.get("yaw_deg", 0.0))
    cos, sin = math.cos(turn), math.sin(turn)
    x, y, z = (float(value) for value in options.get("centre", ORIGIN))
    place = tuple((x + cos * u - sin * v, y + sin * u + cos * v, z + w) for u, v, w in offset)
    to = options["move"]["to"] if "move" in options else (x, y, z)
    return Shape(place, _least(options, offset), (to[0] - x, to[1] - y, to[2] - z))


def size_of_grid(agents: int, options: Mapping[str, Any]) -> tuple[int, int]:
    """Return the number of rows and columns of a grid: as given, or as square as possible.

    >>> size_of_grid(5, {}), size_of_grid(5, {"rows": 1})
    ((2, 3), (1, 5))
    """
    rows = options.get("rows")
    columns = options.get("columns") or math.ceil(agents / rows if rows else math.sqrt(agents))
    return rows or math.ceil(agents / columns), columns


def _line(agents: int, options: Mapping[str, Any]) -> list[Offset]:
    spacing = options.get("spacing", SPACING)
    return [(spacing * (i - (agents - 1) / 2), 0.0, 0.0) for i in range(agents)]


def _grid(agents: int, options: Mapping[str, Any]) -> list[Offset]:
    spacing = options.get("spacing", SPACING)
    rows, columns = size_of_grid(agents, options)
    return [
        (spacing * (column - (columns - 1) / 2), spacing * ((rows - 1) / 2 - row), 0.0)
        for row in range(rows)
        for column in range(columns)
    ]


def _circle(agents: int, options: Mapping[str, Any]) -> list[Offset]:
    radius = options.get("radius")
    if radius is None and agents == 1:
        radius = 0.0
    elif radius is None:  # neighbours are one spacing apart
        radius = options.get("spacing", SPACING) / (2 * math.sin(math.pi / agents))
    turns = [math.tau * i / agents for i in range(agents)]
    return [(radius * math.cos(turn), radius * math.sin(turn), 0.0) for turn in turns]


def _points(_agents: int, options: Mapping[str, Any]) -> list[Offset]:
    return list(options["points"])


OFFSETS: Final = {"line": _line, "grid": _grid, "circle": _circle, "points": _points}
"""Offsets of the positions from the center, m, by shape, before rotation."""


def _least(options: Mapping[str, Any], offset: Sequence[Offset]) -> float:
    """Least distance between two positions, m; neighbours of a named shape are consecutive."""
    if options["shape"] == "points":
        pairs = combinations(offset, 2)
        return min((math.dist(one, other) for one, other in pairs), default=math.inf)
    if len(offset) == 1:
        return math.inf
    if options["shape"] == "circle":
        return math.dist(offset[0], offset[1])
    return float(options.get("spacing", SPACING))
