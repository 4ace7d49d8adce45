"""Writes the world of an import."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from star_import.import_log import show
from star_import.obstacles import Wall
from star_import.tags import Sheet
from star_import.text import Line, word

Point = tuple[float, float, float]
TOP = 2.2  # m, default top of the fence: slightly above the original's greatest height of 2 m


@dataclass(frozen=True, slots=True)
class Room:
    """The fence: its lower and its upper corner, map frame, m."""

    low: Point
    high: Point


def around(points: Iterable[Sequence[float]], margin: float) -> Room:
    """Return a room with a `margin` around points in the plane, m, rounded to 0.1 m."""
    xs, ys = zip(*((p[0], p[1]) for p in points), strict=True)
    west, south = (math.floor((min(values) - margin) * 10) / 10 for values in (xs, ys))
    east, north = (math.ceil((max(values) + margin) * 10) / 10 for values in (xs, ys))
    return Room((west, south, 0.0), (east, north, TOP))


def corners(walls: Iterable[Wall], sheets: Iterable[Sheet]) -> list[tuple[float, float]]:
    """Return the outermost points of walls and sheets."""
    found = [centre for sheet in sheets for centre in sheet.centres]
    for wall in walls:
        half = wall.thickness / 2
        found += [(x + side, y + side) for x, y in wall.points for side in (-half, half)]
    return found


def world_lines(
    name: str, made_of: str, room: Room, walls: Sequence[Wall], sheets: Sequence[Sheet]
) -> list[Line]:
    """Return the lines of a world file."""
    lines = [
        Line(f"# Imported by `star import` from {made_of}."),
        Line("star: 1"),
        Line(f"name: {word(name)}"),
        Line(f"fence: {{low: {show(room.low)}, high: {show(room.high)}}}"),
    ]
    if walls:
        lines += [Line("obstacles:"), *(wall.line() for wall in walls)]
    for kind in ("landmarks", "targets"):
        of_kind = [sheet.line() for sheet in sheets if sheet.kind == kind]
        lines += [Line(f"{kind}:"), *of_kind] if of_kind else []
    return lines
