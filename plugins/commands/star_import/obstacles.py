"""Obstacles of the original STAR's environments as those of a world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from star_import.located import Value
from star_import.notes import Notes, show
from star_import.text import Line, word

TOP: Final = ("environment", "april_tags", "command_sequence", "robots", "robot_types")


@dataclass(frozen=True, slots=True)
class Wall:
    """A wall along the middle of a polyline.

    Attributes:
        name: As the file calls it.
        points: Of the line, m.
        thickness: m.
        height: Of its foot and its top, m.
        place: ``file:line:col``.
    """

    name: str
    points: tuple[tuple[float, float], ...]
    thickness: float
    height: tuple[float, float]
    place: str

    def line(self) -> Line:
        """Return it as a line of a world file."""
        points = [list(point) for point in self.points]
        return Line(
            f"  {word(self.name)}: {{polyline: {show(points)}, thickness: {show(self.thickness)}, "
            f"height: {show(self.height)}}}",
            self.place,
        )


def walls(file: Value, notes: Notes) -> list[Wall]:
    """Return the walls of an environment; those that cannot be said are problems of `notes`."""
    found: list[Wall] = []
    with notes.collected():
        for key, value in file.map().items():
            if key not in TOP:
                notes.say(value.place, f"{key!r} is nothing that an import reads; left out")
        if "environment" not in file.map():
            return found
        for key, value in file.map()["environment"].map().items():
            if key != "obstacles":
                notes.say(value.place, f"{key!r} is nothing that the original reads; left out")
                continue
            for name, given in value.map().items():
                with notes.collected():
                    found.append(_wall(name, given, notes))
    return found


def _wall(name: str, given: Value, notes: Notes) -> Wall:
    offsets = False
    if "use_key_point" in given.map():
        offsets = given.map()["use_key_point"].flag()
    else:
        notes.say(given.place, f"{name} has no 'use_key_point'; its points are absolute")
    listed = given.need("points")
    numbers = listed.numbers()
    if len(numbers) % 2:
        notes.say(listed.place, f"{name}: the last of {len(numbers)} numbers has no pair; left out")
        numbers = numbers[:-1]
    if len(numbers) < 4:  # noqa: PLR2004 -- two points
        raise listed.wrong(f"{name} has {len(numbers)} numbers, expected x and y of two points")
    height = given.need("height")
    try:
        foot, top = height.numbers()
    except ValueError:
        raise height.wrong(f"{name}: expected z of the foot and of the top, m") from None
    thickness = given.need("thickness").number()
    points: list[tuple[float, float]] = []
    x = y = 0.0
    for dx, dy in zip(numbers[::2], numbers[1::2], strict=True):
        x, y = (x + dx, y + dy) if offsets else (dx, dy)
        if points and points[-1] == (x, y):
            notes.say(listed.place, f"{name}: {show([x, y])} stands there twice in a row; once")
        else:
            points.append((x, y))
    if len(points) == 1:
        raise listed.wrong(f"{name} has one point only, expected two that differ")
    said = "the first point in the map, each other from the one before" if offsets else "in the map"
    notes.say(
        given.place,
        f"{name}: {len(points)} points in m, {said}; {show(thickness)} m thick in all; "
        f"from {show(foot)} to {show(top)} m high",
    )
    for key, value in given.map().items():
        if key not in {"use_key_point", "points", "height", "thickness"}:
            notes.say(value.place, f"{name}: {key!r} is nothing that the original reads; left out")
    return Wall(name, tuple(points), thickness, (foot, top), given.place)
