"""The tags of a world file, as sheets to print."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from star_core import InputError, Registry
from star_core.formats import read_as
from star_core.toolkit import TAG_RIM, TAG_SIZE, Page
from star_tags.sheet import Sheet, lay_out

KINDS: Final = {"landmarks": "landmark", "targets": "target"}


def pages(path: Path, paper: str, registry: Registry) -> list[tuple[int, Page]]:
    """Return the number and the page of every tag in the world at `path`.

    Raises:
        InputError: It cannot be read, has no tags or two with the same number, or a tag does not
            fit the paper; lists every reason.
    """
    document = read_as(path, "world", registry)
    problems = []
    named_pages: dict[int, tuple[Page, str]] = {}
    for keys, name, sheet in _sheets(document.data):
        try:
            page = lay_out(sheet, paper)
        except InputError as error:
            problems += [document.problem(keys, problem) for problem in error.problems]
            continue
        if sheet.number in named_pages:
            other = named_pages[sheet.number][1]
            wrong = f"tag {sheet.number} belongs to {other!r} already; give each its own number"
            problems.append(document.problem(keys, wrong, "duplicate-tag"))
        named_pages[sheet.number] = (page, name)
    if not problems and not named_pages:
        raise InputError(f"{path}: has neither landmarks nor targets to print", "no-tags")
    if problems:
        raise InputError(problems)
    return [(number, page) for number, (page, _) in named_pages.items()]


def _sheets(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str | int, ...], str, Sheet]]:
    """Yield every tag with its path in the file and the name of its sheet."""
    for kind, noun in KINDS.items():
        for name, spec in data.get(kind, {}).items():
            size = float(spec.get("size", TAG_SIZE))
            about = f"{name}, a {noun} of {data['name']}"
            for i, number in enumerate(spec["tags"]):
                row = _row(i, spec, size)
                sheet = Sheet(number, size, (f"{about}{row}", _pose(spec)))
                yield (kind, name, "tags", i), name, sheet


def _row(i: int, spec: Mapping[str, Any], size: float) -> str:
    """Return the position of a tag among its neighbours, as text."""
    n = len(spec["tags"])
    if "offsets" in spec:
        right, up = (1000 * value for value in spec["offsets"][i])
        return (
            f": {i + 1} of {n}, middle {right:g} mm right and {up:g} mm up from where it is placed"
        )
    apart = 1000 * spec.get("spacing", TAG_RIM * size)
    return f": {i + 1} of {n} from the left, middles {apart:g} mm apart" if n > 1 else ""


def _pose(spec: Mapping[str, Any]) -> str:
    """Return the pose of a sheet, as text."""
    turns = (f"{turn} {spec.get(f'{turn}_deg', 0):g}°" for turn in ("roll", "pitch", "yaw"))
    row = len(spec["tags"]) > 1 and "offsets" not in spec
    middle = "middle of the row" if row else "placed" if "offsets" in spec else "middle"
    return f"{middle} at {_point(spec['at'])} m in the map, {', '.join(turns)}"


def _point(values: Sequence[float]) -> str:
    return "[" + ", ".join(f"{value:g}" for value in values) + "]"
