"""Piecewise polynomial trajectories, read from CSV. Does not import numpy."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import NamedTuple

from star_core import InputError, polynomial
from star_verbs.follow.rows import numbers, read_rows

Point = tuple[float, float, float]
ORDER = 8  # coefficients of a polynomial of seventh degree
AXES = ("x", "y", "z", "yaw")
COLUMNS = ("duration", *(f"{axis}^{power}" for axis in AXES for power in range(ORDER)))
LONGEST = 1200.0  # s: total duration; a Crazyflie's battery lasts some 420 s
MOST = 1000  # pieces
GREATEST = 1e9  # of a coefficient: with it even 1200 s to the seventh power is a finite number
JUMP = 0.05  # m: between pieces; coefficients are often written with six decimals


class Moment(NamedTuple):
    """State of a trajectory at one time.

    Attributes:
        point: m.
        velocity: m/s.
        acceleration: m/s².
        yaw: rad.
    """

    point: Point
    velocity: Point
    acceleration: Point
    yaw: float


@dataclass(frozen=True, slots=True)
class Piece:
    """One piece of a trajectory.

    Attributes:
        duration: s.
        polynomials: Coefficients, the constant first, of x, y and z, m, and of yaw, rad, over the
            time since the piece began, s.
        line: Its line number in the file.
    """

    duration: float
    polynomials: tuple[tuple[float, ...], ...]
    line: int

    def at(self, time: float) -> Moment:
        """Return its state `time` after its beginning, s."""
        x, y, z = (polynomial(axis, time) for axis in self.polynomials[:3])
        point, velocity, acceleration = zip(x, y, z, strict=True)
        return Moment(point, velocity, acceleration, polynomial(self.polynomials[3], time)[0])


class Trajectory:
    """Pieces that are flown in sequence.

    Args:
        pieces: One or more.

    Attributes:
        pieces: The same.
        begins: Time at which each piece begins, s.
        duration: Total duration, s.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)
        *self.begins, self.duration = accumulate((p.duration for p in pieces), initial=0.0)

    def at(self, time: float) -> Moment:
        """Return its state `time` after its start, s; clamped to its beginning and end.

        >>> straight = ((1.0, 0.5) + (0.0,) * 6, (0.0,) * 8, (1.0,) + (0.0,) * 7, (0.0,) * 8)
        >>> Trajectory([Piece(2.0, straight, 2)]).at(3.0).point
        (2.0, 0.0, 1.0)
        """
        i = max(bisect_right(self.begins, time) - 1, 0)
        piece = self.pieces[i]
        return piece.at(min(max(time - self.begins[i], 0.0), piece.duration))


def read(path: Path, file: str) -> Trajectory:
    """Read a file of pieces in the format of Crazyswarm2 and uav_trajectories.

    It has a header and a line for each piece: its duration and four polynomials of seventh degree,
    for x, y, z and yaw.

    Args:
        path: Path of the file.
        file: Its name in the mission, for messages.

    Raises:
        InputError: The file cannot be used; lists every problem as ``file:line: message``.
    """
    rows = read_rows(path, file)
    if len(rows) < 2:  # noqa: PLR2004 -- a header and a piece
        raise InputError([f"{file}: has no piece, expected a header and one line per piece"])
    header = tuple(cell.strip(" #\t").lower() for cell in _filled(rows[0][1]))
    if header != COLUMNS:
        raise InputError(
            [f"{file}:{rows[0][0]}: expected the header {COLUMNS[0]},{COLUMNS[1]},…,{COLUMNS[-1]}"]
        )
    if len(rows) - 1 > MOST:
        raise InputError([f"{file}: has {len(rows) - 1} pieces, expected {MOST} at most"])
    pieces, problems = [], []
    for line, row in rows[1:]:
        named, faults = numbers(COLUMNS, _filled(row), GREATEST)
        duration, *values = named.values() or [0.0]
        if not faults and duration <= 0:
            faults = [f"duration is {duration:g} s, expected more than 0"]
        problems += [f"{file}:{line}: {message}" for message in faults]
        if not faults:
            axes = (values[ORDER * i : ORDER * (i + 1)] for i in range(len(AXES)))
            pieces.append(Piece(duration, tuple(map(tuple, axes)), line))
    problems = problems or [*_lasts(pieces, file), *_jumps(pieces, file)]
    if problems:
        raise InputError(problems)
    return Trajectory(pieces)


def _filled(row: Sequence[str]) -> Sequence[str]:
    """A row without the empty cells caused by trailing commas."""
    count = len(row)
    while count > len(COLUMNS) and not row[count - 1].strip():
        count -= 1
    return row[:count]


def _lasts(pieces: Sequence[Piece], file: str) -> Iterator[str]:
    """Report the piece at which a trajectory exceeds the greatest duration, if one does."""
    for piece, end in zip(pieces, accumulate(piece.duration for piece in pieces), strict=True):
        if end > LONGEST:
            yield (
                f"{file}:{piece.line}: duration is {piece.duration:g} s and ends {end:g} s after "
                f"the start, expected {LONGEST:g} s at most"
            )
            return


def _jumps(pieces: Sequence[Piece], file: str) -> Iterator[str]:
    for before, after in pairwise(pieces):
        gap = math.dist(before.at(before.duration).point, after.at(0.0).point)
        if gap > JUMP:
            yield (
                f"{file}:{after.line}: begins {gap:.2f} m from the end of the previous piece, "
                f"expected no more than {JUMP} m"
            )
