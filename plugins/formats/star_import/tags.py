"""Converts AprilTags of the original STAR's environments to landmarks and targets of a world."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from star_core.formats import Value
from star_core.toolkit import TAG_RIM
from star_import.import_log import ImportLog, show
from star_import.text import Line

EDGE: Final = 0.157  # m, default edge of the original's tags
YAW: Final = -90.0  # degrees: a sheet's upper edge points to the map's x, its left one to y

Corner = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Sheet:
    """One tag, or a pair of tags on one sheet.

    Attributes:
        kind: ``landmarks`` or ``targets``.
        numbers: Numbers of its tags.
        centres: Their centers, map frame, m.
        edge: Edge of the black squares, m.
        location: Source location, ``file:line:col``.
    """

    kind: str
    numbers: tuple[int, ...]
    centres: tuple[Corner, ...]
    edge: float
    location: str

    def line(self) -> Line:
        """Return it as a line of a world file; offsets are along the sheet's right and up."""
        x, y = (math.fsum(axis) / len(self.centres) for axis in zip(*self.centres, strict=True))
        name = ("target_" if self.kind == "targets" else "tags_") + "_".join(map(str, self.numbers))
        offsets = [[y - v, u - x] for u, v in self.centres]
        spread = f", offsets: {show(offsets)}" if len(self.numbers) > 1 else ""
        return Line(
            f"  {name}: {{tags: {show(list(self.numbers))}, at: {show([x, y, 0.0])}, "
            f"size: {show(self.edge)}, yaw_deg: {YAW:g}{spread}}}",
            self.location,
        )


@dataclass(frozen=True, slots=True)
class Reading:
    """How to interpret a file of tags.

    Attributes:
        edge: Edge of the black squares, m.
        corners: Whether positions are those of the tags' corners, half an edge from their centers
            along x and y, as in the original's flights; otherwise of the centers, as in its
            simulation and its drawings.
        target_positions: Positions of targets that have none in the file, by their number, m.
        shrink: Whether tags of a pair that would overlap are smaller instead of a mistake.
    """

    edge: float
    corners: bool
    target_positions: Mapping[int, Corner]
    shrink: bool = False


def sheets(file: Value, reading: Reading, log: ImportLog) -> list[Sheet]:
    """Return the sheets of an environment; invalid ones are added to the problems of `log`."""
    printed: list[Sheet] = []
    if "april_tags" not in file.map():
        return printed
    with log.collected():
        tags_entry = file.map()["april_tags"]
        what = "lower right corners" if reading.corners else "centers"
        log.add(
            tags_entry.begins_at,
            f"positions of tags are in m and of their {what}; edges of {show(reading.edge)} m; "
            f"every sheet lies on the floor with its upper edge towards x",
        )
        log.ignored(tags_entry, {"pair_position", "pair_paper_size", "tags"})
        for name, tag in tags_entry.need("tags").map().items():
            with log.collected():
                sheet = _sheet(name, tag, tags_entry, reading, log)
                printed += [sheet] if sheet else []
    return printed


def _sheet(name: str, spec: Value, tags: Value, reading: Reading, log: ImportLog) -> Sheet | None:
    if not re.fullmatch(r"id\d{3}( id\d{3})?", name):
        raise spec.wrong(f"{name!r}, expected a tag 'id000' or a pair 'id000 id001'")
    numbers = tuple(int(part[2:]) for part in name.split())
    if "id" in spec.map():
        log.add(spec.map()["id"].begins_at, f"{name}: 'id' is ignored, the key is used")
    purpose = spec.need("purpose").text()
    kind = {"relocalization": "landmarks", "eliminate": "targets"}.get(purpose)
    if kind is None:
        log.add(spec.begins_at, f"{name} is for {purpose!r}, which the original ignores; ignored")
        return None
    location = spec.need("location")
    where = location.numbers()
    if len(where) == 1 and kind == "targets":
        if numbers[0] not in reading.target_positions or len(numbers) > 1:
            log.add(
                location.begins_at,
                f"{name} has no position and is ignored; to add it to the world: "
                f"--target {numbers[0]}=X,Y",
            )
            return None
        x, y = reading.target_positions[numbers[0]]
        return Sheet(kind, numbers, ((x, y),), reading.edge, spec.begins_at)
    if len(where) < 2:  # noqa: PLR2004 -- x and y
        raise location.wrong(f"{name} has {len(where)} numbers, expected x and y, m")
    if len(where) > 2:  # noqa: PLR2004
        log.add(location.begins_at, f"{name} has {len(where)} numbers; the first two are used")
    x, y = where[:2]
    half = reading.edge / 2 if reading.corners else 0.0
    offsets = _pair(name, spec, tags) if len(numbers) > 1 else ((0.0, 0.0),)
    centres = tuple((x + u + half, y + v + half) for u, v in offsets)
    apart = math.dist(centres[0], centres[-1])
    edge = reading.edge
    if len(numbers) > 1 and apart < edge:
        edge = math.floor(apart / TAG_RIM * 1000) / 1000
        pair, what = tags.need("pair_position"), f"tags {apart:.3f} m apart overlap at an edge of"
        if not reading.shrink:
            raise pair.wrong(
                f"{name}: {what} {show(reading.edge)} m; give their size: --tag-size {edge:g} or "
                "less"
            )
        log.warning(pair.begins_at, f"{what} {show(reading.edge)} m; they are flown at {edge:g} m")
    log.add(spec.begins_at, f"{name}: {kind[:-1]} at {', '.join(show(c) for c in centres)} m")
    aligned = {"alignment"} if len(numbers) > 1 else set()
    log.ignored(spec, {"id", "location", "purpose"} | aligned, f"{name}: ")
    return Sheet(kind, numbers, centres, edge, spec.begins_at)


def _pair(name: str, spec: Value, tags: Value) -> tuple[Corner, ...]:
    """Return the offsets of a pair's tags from the corner of the paper that is positioned, m."""
    position, paper = tags.need("pair_position"), tags.need("pair_paper_size")
    try:
        x1, y1, x2, y2 = position.numbers()
        width, length = paper.numbers()
    except ValueError:
        raise position.wrong(
            "expected four numbers in 'pair_position' and two in 'pair_paper_size', m"
        ) from None
    alignment = spec.need("alignment")
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
