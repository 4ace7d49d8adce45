"""Waypoints read from a CSV file. Does not import numpy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from star_core import InputError
from star_verbs.follow.rows import numbers, read_rows

Point = tuple[float, float, float]
NEEDED = ("x", "y", "z")
KNOWN = (*NEEDED, "yaw_deg")


@dataclass(frozen=True, slots=True)
class Waypoints:
    """The content of a file of waypoints.

    Attributes:
        point: Waypoints in order, map frame, m.
        yaw_deg: Heading at each waypoint, degrees; empty if the file has none.
        line: Line number of each waypoint in the file.
    """

    point: tuple[Point, ...]
    yaw_deg: tuple[float, ...]
    line: tuple[int, ...]


def read(path: Path, file: str) -> Waypoints:
    """Read a CSV file with a header that names columns x, y, z and, optionally, yaw_deg.

    Args:
        path: Path of the file.
        file: Its name in the mission, for messages.

    Raises:
        InputError: The file cannot be used; lists every problem as ``file:line: message``.
    """
    rows = read_rows(path, file)
    if not rows:
        raise InputError([f"{file}: is empty, expected a header with columns {_list(KNOWN)}"])
    line, header = rows[0]
    columns = [cell.strip() for cell in header]
    problems = [f"{file}:{line}: {message}" for message in _header_faults(columns)]
    if problems:
        raise InputError(problems)
    points: list[dict[str, float]] = []
    for line, row in rows[1:]:
        values, faults = numbers(columns, row)
        points.append(values)
        problems += [f"{file}:{line}: {message}" for message in faults]
    if not problems and len({tuple(row[key] for key in NEEDED) for row in points}) < 2:  # noqa: PLR2004 -- a line has two ends
        problems = [f"{file}: has {len(points)} points, expected at least 2 that differ"]
    if problems:
        raise InputError(problems)
    return Waypoints(
        point=tuple((row["x"], row["y"], row["z"]) for row in points),
        yaw_deg=tuple(row["yaw_deg"] for row in points if "yaw_deg" in row),
        line=tuple(line for line, _ in rows[1:]),
    )


def _header_faults(columns: Sequence[str]) -> Iterator[str]:
    if len(columns) == 1 and ";" in columns[0]:
        yield "its values are separated by ';', expected commas"
        return
    if all(_is_number(name) for name in columns):
        yield f"begins with numbers, expected a header with columns {_list(KNOWN)}"
        return
    if "duration" in [name.strip(" #").lower() for name in columns]:
        yield "this is a polynomial trajectory; add `format: poly7`"
        return
    for name in NEEDED:
        if name not in columns:
            yield f"no column {name!r}, expected {_list(KNOWN)}"
    for name in dict.fromkeys(columns):
        if name not in KNOWN:
            yield f"unknown column {name!r}, expected {_list(KNOWN)}"
        elif columns.count(name) > 1:
            yield f"column {name!r} is given {columns.count(name)} times"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _list(names: Sequence[str]) -> str:
    return ", ".join(names[:-1]) + f" and, optionally, {names[-1]}"
