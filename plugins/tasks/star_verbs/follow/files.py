"""CSV files of waypoints and of polynomial trajectories."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from star_core import InputError
from star_core.toolkit import polynomial
from star_verbs.follow.trajectory import PolynomialPath
from star_verbs.positions import Point

REQUIRED: Final = ("x", "y", "z")

DEGREES: Final = range(8)  # of a polynomial of seventh degree
PIECE_COLUMNS: Final = (
    "duration",
    *(f"{axis}^{power}" for axis in ("x", "y", "z", "yaw") for power in DEGREES),
)
MAX_SIZE: Final = 1_000_000  # bytes, of a file: 40,000 waypoints
MAX_DURATION: Final = 1200.0  # s: a Crazyflie's battery lasts some 420 s
MAX_PIECES: Final = 1000
MAX_COEFFICIENT: Final = 1e9  # with it even 1200 s to the seventh power is a finite number
MIN_STEP: Final = 0.001  # s, between timed points
MAX_GAP: Final = 0.05  # m, between pieces; coefficients are often written with six decimals


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


def read_waypoints(path: Path, file: str) -> Waypoints:
    """Read a CSV file with a header that names columns x, y, z and, optionally, yaw_deg.

    Args:
        path: Path of the file.
        file: Its name in the mission, for messages.

    Raises:
        InputError: The file cannot be used; lists every problem as ``file:line: message``.
    """
    points = _read_table(path, file, REQUIRED)
    if len({tuple(row[key] for key in REQUIRED) for row in points.values()}) < 2:  # noqa: PLR2004 -- a line has two ends
        raise _invalid(f"{file}: has {len(points)} points, expected at least 2 that differ")
    return Waypoints(
        point=tuple((row["x"], row["y"], row["z"]) for row in points.values()),
        yaw_deg=tuple(row["yaw_deg"] for row in points.values() if "yaw_deg" in row),
        line=tuple(points),
    )


def read_trajectory(path: Path, file: str, form: str) -> PolynomialPath:
    """Read a trajectory in its own time.

    Args:
        path: Path of the file.
        file: Its name in the mission, for messages.
        form: ``timed`` or ``poly7``.

    Raises:
        InputError: The file cannot be used; lists every problem as ``file:line: message``.
    """
    return (_read_timed if form == "timed" else _read_polynomials)(path, file)


def _read_timed(path: Path, file: str) -> PolynomialPath:
    """Read a CSV file with columns t, x, y, z and, optionally, yaw_deg.

    Between the points the line is the cubic spline through them, at rest at both ends: its
    velocity and acceleration do not jump.
    """
    from scipy.interpolate import CubicSpline  # takes long

    points = _read_table(path, file, ("t", *REQUIRED))
    lines, rows = list(points), list(points.values())
    if not 2 <= len(rows) <= MAX_PIECES + 1:  # noqa: PLR2004 -- a line has two ends
        raise _invalid(f"{file}: has {len(rows)} points, expected 2 to {MAX_PIECES + 1}")
    problems = [
        f"{file}:{line}: t is {row['t']:g} s after {before['t']:g} s, expected it to rise by "
        f"{MIN_STEP:g} s or more"
        for line, before, row in zip(lines[1:], rows, rows[1:], strict=False)
        if row["t"] - before["t"] < MIN_STEP
    ]
    if rows[-1]["t"] - rows[0]["t"] > MAX_DURATION:
        problems.append(f"{file}:{lines[-1]}: t is more than {MAX_DURATION:g} s after the first")
    if problems:
        raise _invalid(problems)
    turns = "yaw_deg" in rows[0]
    yaw = np.unwrap(np.radians([row.get("yaw_deg", 0.0) for row in rows]))
    state = np.column_stack([[[row[key] for key in REQUIRED] for row in rows], yaw])
    time = np.array([row["t"] for row in rows])
    spline = CubicSpline(time, state, bc_type="clamped").c  # (4, P, 4), highest power first
    coefficients = np.zeros((len(rows) - 1, 4, len(DEGREES)))
    coefficients[:, :, :4] = spline[::-1].transpose(1, 2, 0)
    return PolynomialPath(np.diff(time), coefficients, lines[1:], turns=turns)


def _read_polynomials(path: Path, file: str) -> PolynomialPath:
    """Read a file of pieces in the format of Crazyswarm2 and uav_trajectories.

    It has a header and a line for each piece: its duration and four polynomials of seventh degree,
    for x, y, z and yaw.
    """
    rows = [(line, _without_trailing_commas(row)) for line, row in _read_rows(path, file)]
    if len(rows) < 2:  # noqa: PLR2004 -- a header and a piece
        raise _invalid(f"{file}: has no piece, expected a header and one line per piece")
    header = tuple(cell.strip(" #\t").lower() for cell in rows[0][1])
    if header != PIECE_COLUMNS:
        expected = f"{PIECE_COLUMNS[0]},{PIECE_COLUMNS[1]},…,{PIECE_COLUMNS[-1]}"
        raise _invalid(f"{file}:{rows[0][0]}: expected the header {expected}")
    if len(rows) - 1 > MAX_PIECES:
        raise _invalid(f"{file}: has {len(rows) - 1} pieces, expected {MAX_PIECES} at most")
    lines, values, problems = [], [], []
    for line, row in rows[1:]:
        named, faults = _numbers(PIECE_COLUMNS, row, MAX_COEFFICIENT)
        if not faults and named["duration"] <= 0:
            faults = [f"duration is {named['duration']:g} s, expected more than 0"]
        problems += [f"{file}:{line}: {message}" for message in faults]
        lines.append(line)
        values.append(list(named.values()))
    if not problems:
        table = np.array(values)
        duration, coefficients = table[:, 0], table[:, 1:].reshape(len(table), 4, len(DEGREES))
        problems = [
            f"{file}:{lines[piece]}: {message}"
            for piece, message in _piece_faults(duration, coefficients)
        ]
    if problems:
        raise _invalid(problems)
    return PolynomialPath(duration, coefficients, lines)


def _read_table(path: Path, file: str, required: Sequence[str]) -> dict[int, dict[str, float]]:
    """Return the numbers of a file with a header, by line and column; ``yaw_deg`` is optional."""
    rows = _read_rows(path, file)
    expected = (*required, "yaw_deg")
    if not rows:
        raise _invalid(f"{file}: is empty, expected a header with columns {_listed(expected)}")
    line, header = rows[0]
    columns = [cell.strip() for cell in header]
    problems = [f"{file}:{line}: {message}" for message in _header_faults(columns, expected)]
    if problems:
        raise _invalid(problems)
    numbers: dict[int, dict[str, float]] = {}
    for line, row in rows[1:]:
        numbers[line], faults = _numbers(columns, row)
        problems += [f"{file}:{line}: {message}" for message in faults]
    if problems:
        raise _invalid(problems)
    return numbers


def _invalid(problems: str | Sequence[str]) -> InputError:
    return InputError(problems, code="invalid-trajectory")


def _read_rows(path: Path, file: str) -> list[tuple[int, list[str]]]:
    """Return the rows of a file that are not blank, each with its line number."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            if os.fstat(stream.fileno()).st_size > MAX_SIZE:
                raise InputError(
                    f"{file}: has more than {MAX_SIZE / 1e6:g} MB", code="unreadable-file"
                )
            reader = csv.reader(stream, strict=True)
            return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        message = f"{file}: cannot be read as CSV in UTF-8: {error}"
        raise InputError(message, code="unreadable-file") from error


def _numbers(
    columns: Sequence[str], row: Sequence[str], limit: float = math.inf
) -> tuple[dict[str, float], list[str]]:
    """Return the numbers of a row by column, and its problems."""
    if len(row) != len(columns):
        return {}, [f"has {len(row)} values, expected {len(columns)}"]
    values: dict[str, float] = {}
    faults = []
    for name, cell in zip(columns, row, strict=True):
        try:
            values[name] = float(cell)
        except ValueError:
            faults.append(f"{name} is {cell.strip()!r}, expected a number")
            continue
        if not math.isfinite(values[name]):
            faults.append(f"{name} is {cell.strip()!r}, expected a finite number")
        elif abs(values[name]) > limit:
            faults.append(f"{name} is {cell.strip()!r}, expected {limit:g} at most")
    return values, faults


def _header_faults(columns: Sequence[str], expected: Sequence[str]) -> Iterator[str]:
    *required, _ = expected
    if len(columns) == 1 and ";" in columns[0]:
        yield "its values are separated by ';', expected commas"
        return
    if all(_is_number(name) for name in columns):
        yield f"begins with numbers, expected a header with columns {_listed(expected)}"
        return
    if "duration" in [name.strip(" #").lower() for name in columns]:
        yield "this is a polynomial trajectory; add `format: poly7`"
        return
    if "t" in columns and "t" not in required:
        yield "its points have times, 't'; add `format: timed`"
        return
    for name in required:
        if name not in columns:
            yield f"no column {name!r}, expected {_listed(expected)}"
    for name in dict.fromkeys(columns):
        if name not in expected:
            yield f"unknown column {name!r}, expected {_listed(expected)}"
        elif columns.count(name) > 1:
            yield f"column {name!r} is given {columns.count(name)} times"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:-1]) + f" and, optionally, {names[-1]}"


def _without_trailing_commas(row: list[str]) -> list[str]:
    count = len(row)
    while count > len(PIECE_COLUMNS) and not row[count - 1].strip():
        count -= 1
    return row[:count]


def _piece_faults(duration: np.ndarray, coefficients: np.ndarray) -> Iterator[tuple[int, str]]:
    """Yield pieces that end too late or do not begin where the previous one ended, and why."""
    end = np.cumsum(duration)
    if end[-1] > MAX_DURATION:
        first = int(np.argmax(end > MAX_DURATION))
        yield (
            first,
            f"duration is {duration[first]:g} s and ends {end[first]:g} s after the start, "
            f"expected {MAX_DURATION:g} s at most",
        )
    ends = polynomial(np.moveaxis(coefficients[:-1, :3], 2, 0), duration[:-1, None])[0]
    for piece, (a, b) in enumerate(zip(ends, coefficients[1:, :3, 0], strict=True), start=1):
        if (gap := math.dist(a, b)) > MAX_GAP:
            yield (
                piece,
                f"begins {gap:.2f} m from the end of the previous piece, "
                f"expected no more than {MAX_GAP} m",
            )
