"""Trajectories that drones fly on their own: their pieces, and how they are uploaded."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core import Array, ContractError, PluginError
from star_radio import orders, packets
from star_radio.tables import Ask

TRAJECTORY_MEMORY: Final = 0x12  # its type
SIZE: Final = 4096  # bytes of it
PIECE: Final = 132  # bytes of a piece: 33 numbers
MOST_PIECES: Final = SIZE // PIECE
_SHAPE: Final = (4, 8)


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece of a trajectory: polynomials of order 7 in the time since its beginning.

    Attributes:
        coefficients: (4, 8) of x, y, z (m) and yaw (rad), the constant first, per s to its power.
        duration: s.
    """

    coefficients: Array
    duration: float

    def __post_init__(self) -> None:
        shape = np.shape(self.coefficients)
        if shape != _SHAPE:
            raise ContractError(f"Piece.coefficients has shape {shape}, expected {_SHAPE}")
        if not (self.duration > 0 and np.isfinite(self.coefficients).all()):
            raise ContractError(
                f"a piece lasts {self.duration!r} s, expected more than 0, and finite coefficients"
            )


def packed(pieces: Sequence[Piece]) -> bytes:
    """Return pieces as the trajectory memory holds them, uncompressed.

    Raises:
        ContractError: There are none, or more than fit.
    """
    if not 0 < len(pieces) <= MOST_PIECES:
        raise ContractError(f"a trajectory has 1 to {MOST_PIECES} pieces, got {len(pieces)}")
    return b"".join(
        np.asarray(piece.coefficients, "<f4").tobytes() + struct.pack("<f", piece.duration)
        for piece in pieces
    )


def upload(number: int, pieces: Sequence[Piece], ask: Ask, *, at: int = 0) -> None:
    """Write a trajectory to a drone's memory, from byte `at` on, and give it a number.

    Takes some 0.1 s per piece on a radio: not for use in a tick.

    Raises:
        ContractError: As `packed`.
        PluginError: The drone does not answer, or refuses.
    """
    data = packed(pieces)
    memory = _memory(ask)
    for done in range(0, len(data), packets.MEMORY_PIECE):
        piece = data[done : done + packets.MEMORY_PIECE]
        question = packets.write_memory(memory, at + done, piece)
        answer = ask(question, question[1:6], "the trajectory memory")
        if answer[5:6] != b"\0":
            raise PluginError(
                f"byte {at + done} of the trajectory memory is refused: {answer[5:].hex()!r}"
            )
    question = orders.define_trajectory(number, len(pieces), at)
    answer = ask(question, question[1:4], f"trajectory {number}")
    if answer[3:4] != b"\0":
        raise PluginError(f"trajectory {number} is refused: error {answer[3:].hex()!r}")


def _memory(ask: Ask) -> int:
    """Return the number of the memory for trajectories.

    Raises:
        PluginError: The firmware has none.
    """
    count = ask(packets.packet(packets.MEMORY, packets.MEMORY_INFO, b"\1"), b"\1", "its memories")[
        1
    ]
    for number in range(count):
        question = packets.memory_info(number)
        answer = ask(question, question[1:3], "its memories")
        if answer[2:3] == bytes([TRAJECTORY_MEMORY]):
            return number
    raise PluginError("its firmware has no memory for trajectories")
