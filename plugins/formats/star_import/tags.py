"""Converts AprilTags of the original STAR's environments to landmarks and targets of a world."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

from star_core.formats import Value
from star_core.toolkit import TAG_RIM
from star_import.import_log import ImportLog, show
from star_import.text import Line

EDGE: Final = 0.157  # m, default edge of the original's tags
SMALLEST: Final = 0.02  # m, edge: nearer tags lie on each other
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

    @property
    def name(self) -> str:
        """Its name in the world."""
        kind = "target_" if self.kind == "targets" else "tags_"
        return kind + "_".join(map(str, self.numbers))

    @property
    def middle(self) -> Corner:
        """The mean of the centers, m."""
        x, y = (math.fsum(axis) / len(self.centres) for axis in zip(*self.centres, strict=True))
        return x, y

    def line(self) -> Line:
        """Return it as a line of a world file; offsets are along the sheet's right and up."""
        x, y = self.middle
        offsets = [[y - v, u - x] for u, v in self.centres]
        spread = f", offsets: {show(offsets)}" if len(self.numbers) > 1 else ""
        return Line(
            f"  {self.name}: {{tags: {show(list(self.numbers))}, at: {show([x, y, 0.0])}, "
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
        new_target: How a position is given to a target, with ``{}`` for its number.
    """

    edge: float
    corners: bool
    target_positions: Mapping[int, Corner]
    new_target: str


def sheets(file: Value, reading: Reading, log: ImportLog) -> list[Sheet]:
    """Return the sheets of an environment; invalid ones are added to the problems of `log`."""
    printed: list[Sheet] = []
    if "april_tags" not in file.map():
        return printed
    with log.collected():
        tags_entry = file.map()["april_tags"]
        what = "lower right corners" if reading.corners else "centers"
        log.assumed(
            tags_entry.begins_at,
            f"positions of tags are in m and of their {what}; edges of {show(reading.edge)} m; "
            f"sheets lie on the floor with their upper edges towards x",
        )
        log.ignore_keys(tags_entry, {"pair_position", "pair_paper_size", "tags"})
        for name, tag in tags_entry.need("tags").map().items():
            with log.collected():
                sheet = _sheet(name, tag, tags_entry, reading, log)
                printed += [sheet] if sheet else []
    return fitted(printed, log)


def fitted(printed: Sequence[Sheet], log: ImportLog) -> list[Sheet]:
    """Return sheets whose tags do not overlap: as large as fit, and none on another."""
    tags = [
        (i, number, centre)
        for i, sheet in enumerate(printed)
        for number, centre in zip(sheet.numbers, sheet.centres, strict=True)
    ]
    edges = [sheet.edge for sheet in printed]
    dropped: set[int] = set()
    for (i, first, centre), (j, second, other) in combinations(tags, 2):
        apart = math.dist(centre, other)
        if apart >= (printed[i].edge + printed[j].edge) / 2 or first in dropped:
            continue
        edge = math.floor(apart / TAG_RIM * 1000) / 1000
        where = printed[j].location
        if edge < SMALLEST:
            dropped.add(second)
            log.changed(where, f"lies on tag {first} and is left out", f"tag {second}")
            continue
        message = (
            f"tags {apart:.3f} m apart overlap at an edge of {show(printed[j].edge)} m; their "
            f"edges are {edge:g} m"
        )
        for k in {i, j}:
            edges[k] = min(edges[k], edge)
            log.changed(printed[k].location, message, printed[k].name)
    kept = []
    for sheet, edge in zip(printed, edges, strict=True):
        rest = [k for k, number in enumerate(sheet.numbers) if number not in dropped]
        numbers = tuple(sheet.numbers[k] for k in rest)
        centres = tuple(sheet.centres[k] for k in rest)
        if rest:
            kept.append(replace(sheet, numbers=numbers, centres=centres, edge=edge))
    return kept


def _sheet(name: str, spec: Value, tags: Value, reading: Reading, log: ImportLog) -> Sheet | None:
    if not re.fullmatch(r"id\d{3}( id\d{3})?", name):
        raise spec.wrong(f"{name!r}, expected a tag 'id000' or a pair 'id000 id001'")
    numbers = tuple(int(part[2:]) for part in name.split())
    if "id" in spec.map():
        log.ignored(spec.map()["id"].begins_at, "the key is the number of a tag, 'id' is not", name)
    purpose = spec.need("purpose").text()
    kind = {"relocalization": "landmarks", "eliminate": "targets"}.get(purpose)
    if kind is None:
        log.ignored(spec.begins_at, f"the original has no purpose {purpose!r}", name)
        return None
    location = spec.need("location")
    where = location.numbers()
    if len(where) == 1 and kind == "targets":
        if numbers[0] not in reading.target_positions or len(numbers) > 1:
            hint = reading.new_target.format(numbers[0])
            text = f"targets without a position are not in the world; {hint} adds one"
            log.ignored(location.begins_at, re.sub(r"\b\d+=", "TAG=", text), name)
            return None
        x, y = reading.target_positions[numbers[0]]
        return Sheet(kind, numbers, ((x, y),), reading.edge, spec.begins_at)
    if len(where) < 2:  # noqa: PLR2004 -- x and y
        raise location.wrong(f"{name} has {len(where)} numbers, expected x and y, m")
    if len(where) > 2:  # noqa: PLR2004
        log.ignored(location.begins_at, "of 'location' the first two numbers are used", name)
    x, y = where[:2]
    half = reading.edge / 2 if reading.corners else 0.0
    offsets = _pair(name, spec, tags, log) if len(numbers) > 1 else ((0.0, 0.0),)
    centres = tuple((x + u + half, y + v + half) for u, v in offsets)
    aligned = {"alignment"} if len(numbers) > 1 else set()
    log.ignore_keys(spec, {"id", "location", "purpose"} | aligned, "tags.")
    return Sheet(kind, numbers, centres, reading.edge, spec.begins_at)


def _pair(name: str, spec: Value, tags: Value, log: ImportLog) -> tuple[Corner, ...]:
    """Return the offsets of a pair's tags from the corner of the paper that is positioned, m."""
    position, paper = tags.need("pair_position"), tags.need("pair_paper_size")
    try:
        x1, y1, x2, y2 = position.numbers()
        width, length = paper.numbers()
    except ValueError:
        raise position.wrong(
            "expected four numbers in 'pair_position' and two in 'pair_paper_size', m"
        ) from None
    corners = {
        "top-left": (0.0, 0.0),
        "top-right": (0.0, length),
        "bottom-right": (width, length),
        "bottom-left": (width, 0.0),
    }
    if "alignment" not in spec.map():
        log.assumed(
            spec.begins_at, "pairs without 'alignment' are positioned by their top-left", name
        )
        return (x1, y1), (x2, y2)
    alignment = spec.map()["alignment"]
    if alignment.text() not in corners:
        raise alignment.wrong(
            f"{name}: no corner {alignment.text()!r}, expected one of {', '.join(corners)}"
        )
    dx, dy = corners[alignment.text()]
    return (x1 + dx, y1 + dy), (x2 + dx, y2 + dy)
