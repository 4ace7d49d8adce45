"""Converts obstacles of the original STAR's environments to those of a world."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import accumulate
from typing import Final

from star_core import Obstacle
from star_core.formats import Value
from star_core.formats import wall as outlines
from star_import.import_log import NOT_SUPPORTED, ImportLog, show
from star_import.text import Line, word

FACE: Final = 0.01  # m, from a face of a wall, within which a tag is stuck on it
SAME: Final = 1e-6  # m: points that are nearer are one; sums of offsets have rounding errors
READ: Final = ("use_key_point", "points", "height", "thickness")
TOP: Final = ("environment", "april_tags", "command_sequence", "robots", "robot_types")


@dataclass(frozen=True, slots=True)
class Wall:
    """A wall along a polyline.

    Attributes:
        name: Name in the file.
        points: Points of its center line, m.
        thickness: m.
        height: Height of its bottom and its top, m.
        location: Source location, ``file:line:col``.
        flat: Whether it ends at its first and its last point, not half a thickness beyond.
    """

    name: str
    points: tuple[tuple[float, float], ...]
    thickness: float
    height: tuple[float, float]
    location: str
    flat: bool

    @property
    def solid(self) -> Obstacle:
        """The space that it fills."""
        return Obstacle(
            self.name, outlines(self.points, self.thickness, flat=self.flat), self.height
        )

    def line(self, *, virtual: bool) -> Line:
        """Return it as a line of a world file."""
        points = [list(point) for point in self.points]
        more = ", flat_ends: true" if self.flat else ""
        more += ", virtual: true" if virtual else ""
        return Line(
            f"  {word(self.name)}: {{polyline: {show(points)}, thickness: {show(self.thickness)}, "
            f"height: {show(self.height)}{more}}}",
            self.location,
        )


def has_inside(wall: Wall, position: tuple[float, float]) -> bool:
    """Return whether a tag on the floor is inside a wall, and not on one of its faces."""
    solid, (x, y) = wall.solid, position
    return wall.height[1] > 0 and all(
        solid.contains((x + dx, y + dy, 0.0)) for dx in (-FACE, FACE) for dy in (-FACE, FACE)
    )


def walls(file: Value, log: ImportLog, *, flat: bool) -> list[Wall]:
    """Return the walls of an environment; invalid ones are added to the problems of `log`.

    Args:
        file: The environment.
        log: Log of assumptions.
        flat: Whether they end at their first and last points.
    """
    built: list[Wall] = []
    with log.collected():
        log.ignore_keys(file, TOP, why=NOT_SUPPORTED)
        if "environment" not in file.map():
            return built
        environment = file.map()["environment"]
        log.ignore_keys(environment, {"obstacles"})
        if "obstacles" in environment.map():
            for name, spec in environment.map()["obstacles"].map().items():
                with log.collected():
                    built.append(_wall(name, spec, log, flat=flat))
    if built:
        ends = (
            "end at their last points" if flat else "reach half their thickness beyond their ends"
        )
        where = environment.begins_at
        log.assumed(where, f"points, heights and thicknesses are in m, and walls {ends}")
    return built


def _wall(name: str, spec: Value, log: ImportLog, *, flat: bool) -> Wall:
    offsets = False
    if "use_key_point" in spec.map():
        offsets = spec.map()["use_key_point"].flag()
    else:
        log.assumed(spec.begins_at, "points without 'use_key_point' are absolute", name)
    listed = spec.need("points")
    numbers = listed.numbers()
    if len(numbers) % 2:
        log.ignored(listed.begins_at, "the last number of 'points' has no pair", name)
        numbers = numbers[:-1]
    if len(numbers) < 4:  # noqa: PLR2004 -- two points
        raise listed.wrong(f"{name} has {len(numbers)} numbers, expected x and y of two points")
    height = spec.need("height")
    try:
        foot, top = height.numbers()
    except ValueError:
        raise height.wrong(f"{name}: expected z of the bottom and of the top, m") from None
    thickness = spec.need("thickness").number()
    xs: Iterable[float] = numbers[::2]
    ys: Iterable[float] = numbers[1::2]
    if offsets:  # each from the point before it, the first from the origin
        xs, ys = accumulate(xs), accumulate(ys)
    points: list[tuple[float, float]] = []
    for point in zip(xs, ys, strict=True):
        if points and math.dist(points[-1], point) < SAME:
            log.ignored(listed.begins_at, "a point is repeated", name)
        else:
            points.append(point)
    if len(points) == 1:
        raise listed.wrong(f"{name} has one point only, expected two that differ")
    if math.dist(points[0], points[-1]) < SAME:
        points[-1] = points[0]
    log.ignore_keys(spec, READ, "obstacles.")
    return Wall(name, tuple(points), thickness, (foot, top), spec.begins_at, flat)
