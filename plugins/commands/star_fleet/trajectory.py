"""Trajectories in the memory of a vehicle, as clients upload them."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Final

import numpy as np

from star_core import Array
from star_fleet.packet import read
from star_sim.pieces import ORDER, Piece

PIECE_BYTES: Final = 33 * 4
CONTROL_POINTS: Final = (0, 1, 3, 7)  # that are stored of an axis, by its two bits of type
MAX_COEFFICIENT: Final = 1e6  # of a coefficient, so that nothing overflows


def plain(memory: bytes, offset: int, count: int) -> list[Piece] | None:
    """Return `count` pieces of ``poly4d``; None if they are not in the memory, or cannot be flown.

    A piece has 8 coefficients over the time in seconds for each of x, y, z (m) and yaw (rad), and a
    duration, s.
    """
    if count < 1 or offset + count * PIECE_BYTES > len(memory):
        return None
    pieces = []
    for i in range(count):
        *numbers, duration = struct.unpack_from("<33f", memory, offset + i * PIECE_BYTES)
        if not (math.isfinite(duration) and duration > 0):
            return None
        with np.errstate(over="ignore", invalid="ignore"):
            pieces.append(Piece.over_time(np.reshape(numbers, (4, 8)), duration))
    return _flyable(pieces)


def compressed(memory: bytes, offset: int) -> list[Piece] | None:
    """Return the pieces of a compressed trajectory, up to one of no duration or the memory's end.

    It starts with x, y, z in mm and yaw in 0.1°. A piece has a byte with two bits of type for each
    axis, its duration in ms, and for each axis the 0, 1, 3 or 7 control points of a Bézier curve
    that goes on from where the last piece ended.
    """
    start = read("hhhh", memory, offset)
    if start is None:
        return None
    endpoint = [_unit(axis) * value for axis, value in enumerate(start)]
    offset += 8
    pieces = []
    while (header := read("BH", memory, offset)) is not None and header[1] > 0:
        kinds, duration = header
        offset += 3
        coefficients = np.zeros((4, ORDER + 1))
        for axis in range(4):
            count = CONTROL_POINTS[kinds >> 2 * axis & 3]
            stored = read(f"{count}h", memory, offset)
            if stored is None:
                return None
            offset += 2 * count
            points = [endpoint[axis], *(_unit(axis) * value for value in stored)]
            coefficients[axis, : count + 1] = bezier(points)
            endpoint[axis] = points[-1]
        pieces.append(Piece(coefficients, duration / 1000))
    return _flyable(pieces)


def bezier(points: Sequence[float]) -> Array:
    """Return the coefficients over [0, 1] of the Bézier curve with some control points.

    >>> bezier([1.0, 1.0, 4.0])
    array([1., 0., 3.])
    """
    order = len(points) - 1
    return np.array(
        [
            math.comb(order, j)
            * sum(math.comb(j, i) * (-1) ** (i + j) * points[i] for i in range(j + 1))
            for j in range(order + 1)
        ],
        float,
    )


def _unit(axis: int) -> float:
    return math.radians(0.1) if axis == 3 else 0.001  # noqa: PLR2004 -- yaw


def _flyable(pieces: list[Piece]) -> list[Piece] | None:
    """Return the pieces; None if there are none, or one has no finite coefficients."""
    if not pieces or not all(
        (np.abs(piece.coefficients) <= MAX_COEFFICIENT).all() for piece in pieces
    ):
        return None
    return pieces
