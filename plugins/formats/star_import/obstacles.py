"""Converts obstacles of the original STAR's environments to those of a world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from star_core import Obstacle
from star_core.formats import Value
from star_core.formats import wall as outlines
from star_import.import_log import NOT_SUPPORTED, ImportLog, show
from star_import.text import Line, word

FACE: Final = 0.01  # m, from a face of a wall, within which a tag is stuck on it
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
    """

    name: str
    points: tuple[tuple[float, float], ...]
    thickness: float
    height: tuple[float, float]
    location: str

    def line(self) -> Line:
        """Return it as a line of a world file."""
        points = [list(point) for point in self.points]
        return Line(
            f"  {word(self.name)}: {{polyline: {show(points)}, thickness: {show(self.thickness)}, "
            f"height: {show(self.height)}}}",
            self.location,
        )


def inside(wall: Wall, position: tuple[float, float]) -> bool:
    """Return whether a tag on the floor is inside a wall, and not on one of its faces."""
    solid = Obstacle(wall.name, outlines(wall.points, wall.thickness), wall.height)
    x, y = position
    return wall.height[1] > 0 and all(
        solid.contains((x + dx, y + dy, 0.0)) for dx in (-FACE, FACE) for dy in (-FACE, FACE)
    )


def walls(file: Value, log: ImportLog) -> list[Wall]:
    """Return the walls of an environment; invalid ones are added to the problems of `log`."""
    built: list[Wall] = []
    with log.collected():
        log.ignored(file, TOP, why=NOT_SUPPORTED)
        if "environment" not in file.map():
            return built
        environment = file.map()["environment"]
        log.ignored(environment, {"obstacles"})
        if "obstacles" in environment.map():
            for name, spec in environment.map()["obstacles"].map().items():
                with log.collected():
                    built.append(_wall(name, spec, log))
    return built


def _wall(name: str, spec: Value, log: ImportLog) -> Wall:
    offsets = False
    if "use_key_point" in spec.map():
        offsets = spec.map()["use_key_point"].flag()
    else:
        log.add(spec.begins_at, f"{name} has no 'use_key_point'; its points are absolute")
    listed = spec.need("points")
    numbers = listed.numbers()
    if len(numbers) % 2:
        log.add(
            listed.begins_at, f"{name}: the last of {len(numbers)} numbers has no pair; ignored"
        )
        numbers = numbers[:-1]
    if len(numbers) < 4:  # noqa: PLR2004 -- two points
        raise listed.wrong(f"{name} has {len(numbers)} numbers, expected x and y of two points")
    height = spec.need("height")
    try:
        foot, top = height.numbers()
    except ValueError:
        raise height.wrong(f"{name}: expected z of the bottom and of the top, m") from None
    thickness = spec.need("thickness").number()
    points: list[tuple[float, float]] = []
    x = y = 0.0
    for dx, dy in zip(numbers[::2], numbers[1::2], strict=True):
        x, y = (x + dx, y + dy) if offsets else (dx, dy)
        if points and points[-1] == (x, y):
            log.add(listed.begins_at, f"{name}: {show([x, y])} is repeated; used once")
        else:
            points.append((x, y))
    if len(points) == 1:
        raise listed.wrong(f"{name} has one point only, expected two that differ")
    kind = "relative to the previous point, the first to the map" if offsets else "in the map"
    log.add(
        spec.begins_at,
        f"{name}: {len(points)} points in m, {kind}; {show(thickness)} m thick in all; "
        f"from {show(foot)} to {show(top)} m high",
    )
    log.ignored(spec, {"use_key_point", "points", "height", "thickness"}, f"{name}: ")
    return Wall(name, tuple(points), thickness, (foot, top), spec.begins_at)
