"""AprilTags of the original STAR's environments as landmarks and targets of a world."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from star_import.located import Value
from star_import.notes import Notes, show
from star_import.text import Line

EDGE: Final = 0.157  # m, the edge of the original's tags, as shipped
RIM: Final = 1.25  # width of a tag with its white rim over that of its black square
YAW: Final = -90.0  # degrees: a sheet's upper edge lies towards the map's x, its left one towards y

Corner = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Sheet:
    """One tag, or a pair on one sheet.

    Attributes:
        kind: ``landmarks`` or ``targets``.
        numbers: Of its tags.
        centres: Their middles, map frame, m.
        edge: Of the black squares, m.
        place: ``file:line:col``.
    """

    kind: str
    numbers: tuple[int, ...]
    centres: tuple[Corner, ...]
    edge: float
    place: str

    def line(self) -> Line:
        """Return it as a line of a world file; offsets are along the sheet's right and up."""
        x, y = (math.fsum(axis) / len(self.centres) for axis in zip(*self.centres, strict=True))
        name = ("target_" if self.kind == "targets" else "tags_") + "_".join(map(str, self.numbers))
        offsets = [[y - v, u - x] for u, v in self.centres]
        spread = f", offsets: {show(offsets)}" if len(self.numbers) > 1 else ""
        return Line(
            f"  {name}: {{tags: {show(list(self.numbers))}, at: {show([x, y, 0.0])}, "
            f"size: {show(self.edge)}, yaw_deg: {YAW:g}{spread}}}",
            self.place,
        )


@dataclass(frozen=True, slots=True)
class Reading:
    """How a file of tags is to be read.

    Attributes:
        edge: Of the black squares, m.
        corners: Whether the places are of the tags' corners, half an edge from their middles along
            x and y, as the original's flights had it; else they are of the middles, as its
            simulation and its drawings had it.
        placed: Where targets lie that the file knows no place of, by their number, m.
    """

    edge: float
    corners: bool
    placed: Mapping[int, Corner]


def sheets(file: Value, reading: Reading, notes: Notes) -> list[Sheet]:
    """Return the sheets of an environment; those that cannot be said are problems of `notes`."""
    found: list[Sheet] = []
    if "april_tags" not in file.map():
        return found
    with notes.collected():
        given = file.map()["april_tags"]
        what = "lower right corners" if reading.corners else "middles"
        notes.say(
            given.place,
            f"places of tags are in m and of their {what}; edges of {show(reading.edge)} m; "
            f"every sheet lies on the floor with its upper edge towards x",
        )
        for key, value in given.map().items():
            if key not in {"pair_position", "pair_paper_size", "tags"}:
                notes.say(value.place, f"{key!r} is nothing that the original reads; left out")
        for name, tag in given.need("tags").map().items():
            with notes.collected():
                sheet = _sheet(name, tag, given, reading, notes)
                found += [sheet] if sheet else []
    return found


def _sheet(name: str, given: Value, tags: Value, reading: Reading, notes: Notes) -> Sheet | None:
    if not re.fullmatch(r"id\d{3}( id\d{3})?", name):
        raise given.wrong(f"{name!r}, expected a tag 'id000' or a pair 'id000 id001'")
    numbers = tuple(int(part[2:]) for part in name.split())
    if "id" in given.map():
        notes.say(given.map()["id"].place, f"{name}: 'id' is ignored, the key counts")
    purpose = given.need("purpose").text()
    kind = {"relocalization": "landmarks", "eliminate": "targets"}.get(purpose)
    if kind is None:
        notes.say(given.place, f"{name} is for {purpose!r}, which the original ignores; left out")
        return None
    location = given.need("location")
    where = location.numbers()
    if len(where) == 1 and kind == "targets":
        if numbers[0] not in reading.placed or len(numbers) > 1:
            notes.say(
                location.place,
                f"{name} has no place and is left out; to put it into the world: "
                f"--target {numbers[0]}=X,Y",
            )
            return None
        x, y = reading.placed[numbers[0]]
        return Sheet(kind, numbers, ((x, y),), reading.edge, given.place)
    if len(where) < 2:  # noqa: PLR2004 -- x and y
        raise location.wrong(f"{name} has {len(where)} numbers, expected x and y, m")
    if len(where) > 2:  # noqa: PLR2004
        notes.say(location.place, f"{name} has {len(where)} numbers; the first two are its place")
    x, y = where[:2]
    half = reading.edge / 2 if reading.corners else 0.0
    offsets = _pair(name, given, tags) if len(numbers) > 1 else ((0.0, 0.0),)
    centres = tuple((x + u + half, y + v + half) for u, v in offsets)
    apart = math.dist(centres[0], centres[-1])
    if len(numbers) > 1 and apart < reading.edge:
        raise tags.need("pair_position").wrong(
            f"{name}: tags {apart:.3f} m apart overlap at an edge of {show(reading.edge)} m; say "
            f"how large they are: --tag-size {math.floor(apart / RIM * 1000) / 1000:g} or less"
        )
    notes.say(given.place, f"{name}: {kind[:-1]} at {', '.join(show(c) for c in centres)} m")
    pair = {"alignment"} if len(numbers) > 1 else set()
    _left_out(name, given, {"id", "location", "purpose"} | pair, notes)
    return Sheet(kind, numbers, centres, reading.edge, given.place)


def _left_out(name: str, given: Value, read: set[str], notes: Notes) -> None:
    """Tell what else stands there."""
    for key, value in given.map().items():
        if key not in read:
            notes.say(value.place, f"{name}: {key!r} is nothing that the original reads; left out")


def _pair(name: str, given: Value, tags: Value) -> tuple[Corner, ...]:
    """How far the tags of a pair lie from the corner of the paper whose place is given, m."""
    position, paper = tags.need("pair_position"), tags.need("pair_paper_size")
    try:
        x1, y1, x2, y2 = position.numbers()
        width, length = paper.numbers()
    except ValueError:
        raise position.wrong(
            "expected four numbers in 'pair_position' and two in 'pair_paper_size', m"
        ) from None
    alignment = given.need("alignment")
    corners = {
        "top-left": (0.0, 0.0),
        "top-right": (0.0, length),
        "bottom-right": (width, length),
        "bottom-left": (width, 0.0),
    }
    if alignment.text() not in corners:
        raise alignment.wrong(
            f"{name}: no corner {alignment.text()!r}, expected one of {', '.join(corners)}"
        )
    dx, dy = corners[alignment.text()]
    return (x1 + dx, y1 + dy), (x2 + dx, y2 + dy)
