"""Trajectories of polynomial pieces, read from CSV. Nothing here imports numpy."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import NamedTuple

from star_core import InputError
from star_verbs.follow.rows import numbers, read_rows

Point = tuple[float, float, float]
ORDER = 8  # coefficients of a polynomial of seventh degree
AXES = ("x", "y", "z", "yaw")
COLUMNS = ("duration", *(f"{axis}^{power}" for axis in AXES for power in range(ORDER)))
LONGEST = 1200.0  # s: of all pieces; a Crazyflie's battery lasts some 420 s
MOST = 1000  # pieces
GREATEST = 1e9  # of a coefficient: with it even 1200 s to the seventh power is a finite number
JUMP = 0.05  # m: from piece to piece; coefficients are often written with six decimals


class Moment(NamedTuple):
    """Where a trajectory is at one time.

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
        line: Line of the file that it stands on.
    """

    duration: float
    polynomials: tuple[tuple[float, ...], ...]
    line: int

    def at(self, time: float) -> Moment:
        """Return where it is `time` after it began, s; Horner's rule for the polynomials."""
        x, y, z = (_derivatives(axis, time) for axis in self.polynomials[:3])
        point, velocity, acceleration = zip(x, y, z, strict=True)
        return Moment(point, velocity, acceleration, _derivatives(self.polynomials[3], time)[0])


class Trajectory:
    """Pieces that are flown one after the other.

    Args:
        pieces: One or more.

    Attributes:
        pieces: What was given.
        begins: When each piece begins, s.
        duration: Of all, s.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)
        *self.begins, self.duration = accumulate((p.duration for p in pieces), initial=0.0)

    def at(self, time: float) -> Moment:
        """Return where it is `time` after its start, s; before and after, where it begins or ends.

        >>> straight = ((1.0, 0.5) + (0.0,) * 6, (0.0,) * 8, (1.0,) + (0.0,) * 7, (0.0,) * 8)
        >>> Trajectory([Piece(2.0, straight, 2)]).at(3.0).point
        (2.0, 0.0, 1.0)
        """
        i = max(bisect_right(self.begins, time) - 1, 0)
        piece = self.pieces[i]
        return piece.at(min(max(time - self.begins[i], 0.0), piece.duration))


def read(path: Path, file: str) -> Trajectory:
    """Read a file of pieces as Crazyswarm2 and uav_trajectories write it.

    It has a header and a line for each piece: its duration and four polynomials of seventh degree,
    for x, y, z and yaw.

    Args:
        path: Where it is.
        file: What the mission calls it, for messages.

    Raises:
        InputError: The file cannot be used; every problem is told as ``file:line: what is wrong``.
    """
    rows = read_rows(path, file)
    if len(rows) < 2:  # noqa: PLR2004 -- a header and a piece
        raise InputError([f"{file}: has no piece, expected a header and a line for each"])
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


def _derivatives(polynomial: Iterable[float], time: float) -> tuple[float, float, float]:
    """Value, first and second derivative of a polynomial."""
    value = first = half = 0.0
    for coefficient in reversed(tuple(polynomial)):
        half = half * time + first
        first = first * time + value
        value = value * time + coefficient
    return value, first, 2 * half


def _filled(row: Sequence[str]) -> Sequence[str]:
    """A row without the empty cells that a comma at its end makes."""
    count = len(row)
    while count > len(COLUMNS) and not row[count - 1].strip():
        count -= 1
    return row[:count]


def _lasts(pieces: Sequence[Piece], file: str) -> Iterator[str]:
    """The piece with which a trajectory takes too long, if one does."""
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
                f"{file}:{after.line}: begins {gap:.2f} m from where the piece before ends, "
                f"expected no more than {JUMP} m"
            )
