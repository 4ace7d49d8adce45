"""Writes the world of an import."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from star_import.notes import show
from star_import.obstacles import Wall
from star_import.tags import Sheet
from star_import.text import Line, word

Point = tuple[float, float, float]
TOP = 2.2  # m, of a fence that no file says: a little over the original's greatest height of 2 m


@dataclass(frozen=True, slots=True)
class Room:
    """The fence: its lowest and its highest corner, map frame, m."""

    low: Point
    high: Point


def around(points: Iterable[Sequence[float]], margin: float) -> Room:
    """Return a room that keeps `margin` around points in the plane, m, to the next 0.1 m."""
    xs, ys = zip(*((p[0], p[1]) for p in points), strict=True)
    west, south = (math.floor((min(values) - margin) * 10) / 10 for values in (xs, ys))
    east, north = (math.ceil((max(values) + margin) * 10) / 10 for values in (xs, ys))
    return Room((west, south, 0.0), (east, north, TOP))


def corners(walls: Iterable[Wall], sheets: Iterable[Sheet]) -> list[tuple[float, float]]:
    """Return points that are as far out as what is in a world."""
    found = [centre for sheet in sheets for centre in sheet.centres]
    for wall in walls:
        half = wall.thickness / 2
        found += [(x + side, y + side) for x, y in wall.points for side in (-half, half)]
    return found


def world_lines(
    name: str, made_of: str, room: Room, walls: Sequence[Wall], sheets: Sequence[Sheet]
) -> list[Line]:
    """Return a world file."""
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
