"""On-board trajectories: their format and their upload."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core import ContractError, PluginError, Trajectory
from star_radio import orders, packets
from star_radio.answers import Ask, Question

TRAJECTORY_MEMORY: Final = 0x12  # type of the memory
SIZE: Final = 4096  # bytes of the memory
PIECE: Final = 132  # bytes of a piece: 33 numbers
MOST_PIECES: Final = SIZE // PIECE


def packed(trajectory: Trajectory) -> bytes:
    """Return a trajectory's pieces in the uncompressed format of the trajectory memory.

    Raises:
        ContractError: There are more than fit.
    """
    count = len(trajectory.duration)
    if count > MOST_PIECES:
        raise ContractError(f"a trajectory has 1 to {MOST_PIECES} pieces, got {count}")
    pieces = np.column_stack([trajectory.coefficients.reshape(count, -1), trajectory.duration])
    return pieces.astype("<f4").tobytes()


def upload(number: int, trajectory: Trajectory, ask: Ask, *, at: int = 0) -> None:
    """Write a trajectory to a drone's memory, from byte `at` on, and assign it a number.

    Takes about 0.1 s per piece over radio: not for use in a tick.

    Raises:
        ContractError: As `packed`.
        PluginError: The drone does not answer or refuses.
    """
    data = packed(trajectory)
    memory = _memory(ask)
    places = range(0, len(data), packets.MEMORY_PIECE)
    writes = [
        packets.write_memory(memory, at + done, data[done : done + packets.MEMORY_PIECE])
        for done in places
    ]
    answers = ask([Question.of(one, one[1:6], "the trajectory memory") for one in writes])
    for done, answer in zip(places, answers, strict=True):
        if answer[5:6] != b"\0":
            raise PluginError(
                f"byte {at + done} of the trajectory memory is refused: {answer[5:].hex()!r}"
            )
    packet = orders.define_trajectory(number, len(trajectory.duration), at)
    (answer,) = ask([Question.of(packet, packet[1:4], f"trajectory {number}")])
    if answer[3:4] != b"\0":
        raise PluginError(f"trajectory {number} is refused: error {answer[3:].hex()!r}")


def _memory(ask: Ask) -> int:
    """Return the number of the trajectory memory.

    Raises:
        PluginError: The firmware has none.
    """
    about = "its memories"
    packet = packets.packet(packets.MEMORY, packets.MEMORY_INFO, b"\1")
    (answer,) = ask([Question.of(packet, b"\1", about)])
    infos = [packets.memory_info(number) for number in range(answer[1])]
    for number, info in enumerate(ask([Question.of(one, one[1:3], about) for one in infos])):
        if info[2:3] == bytes([TRAJECTORY_MEMORY]):
            return number
    raise PluginError("its firmware has no memory for trajectories")
