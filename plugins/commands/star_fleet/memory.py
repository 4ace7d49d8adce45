"""Memories that a client reads and writes over the link, and the trajectories in them."""

from __future__ import annotations

import errno
import math
import struct
from collections.abc import Sequence
from typing import Final

import numpy as np

from star_core import Array
from star_fleet.packet import read
from star_sim.pieces import ORDER, Piece

EEPROM, TRAJECTORY = 0x00, 0x12  # types
TRAJECTORY_BYTES: Final = 4096  # 31 pieces of poly4d
EEPROM_BYTES: Final = 112
MAX_READ: Final = 24  # bytes in an answer

COUNT, DETAILS = 1, 2  # commands of the channel 0
INFO, READ, WRITE = 0, 1, 2  # channels


class Memories:
    """All memories of one vehicle.

    Args:
        address: The vehicle's on the radio, five bytes.
    """

    def __init__(self, address: int) -> None:
        self.trajectory: Final = bytearray(TRAJECTORY_BYTES)
        self._memories = (
            (EEPROM, bytearray(_configuration(address).ljust(EEPROM_BYTES, b"\xff"))),
            (TRAJECTORY, self.trajectory),
        )

    def answer(self, channel: int, payload: bytes) -> bytes | None:
        """Return the answer to a question or an order; None for other packets."""
        if channel == INFO:
            return self._info(payload)
        head = read("BI", payload)
        if head is None or (channel == READ and len(payload) <= 5):  # noqa: PLR2004 -- no length
            return None
        number, start = head
        memory = self._memories[number][1] if number < len(self._memories) else bytearray()
        if channel == READ:
            count = payload[5]
            fits = count <= MAX_READ and start + count <= len(memory)
            data = bytes(memory[start : start + count]) if fits else b""
        elif channel == WRITE:
            data = payload[5:]
            fits = start + len(data) <= len(memory)
            if fits:
                memory[start : start + len(data)] = data
            data = b""
        else:
            return None
        return payload[:5] + bytes([0 if fits else errno.EIO]) + data

    def _info(self, payload: bytes) -> bytes | None:
        if payload[:1] == bytes([COUNT]):
            return bytes([COUNT, len(self._memories)])
        if payload[:1] == bytes([DETAILS]) and len(payload) > 1:
            number = payload[1]
            if number >= len(self._memories):
                return payload[:2]
            kind, memory = self._memories[number]
            return struct.pack("<BBBI8x", DETAILS, number, kind, len(memory))
        return None


def _configuration(address: int) -> bytes:
    """Return the block at the start of the EEPROM: channel 80, 2 Mbit/s, no trim, the address."""
    block = b"0xBC" + struct.pack(
        "<BBBffBI", 1, 80, 2, 0.0, 0.0, address >> 32, address & 0xFFFFFFFF
    )
    return block + bytes([sum(block) % 256])


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
