"""Trajectories in the drones' memories: their format, layout, upload and start."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Final

import numpy as np

from star_core import ContractError, PluginError, Trajectory
from star_core.toolkit import transformed, wrap_angle
from star_radio import orders
from star_radio.connection import packets
from star_radio.connection.questions import Ask, Question

TRAJECTORY_MEMORY: Final = 0x12  # type of the memory
SIZE: Final = 4096  # bytes of the memory
PIECE: Final = 132  # bytes of a piece: 33 numbers
MAX_PIECES: Final = SIZE // PIECE
_DESCENT_PIECES: Final = 2  # a hover and a descent
MAX_TRAJECTORIES: Final = 10  # of the firmware (``NUM_TRAJECTORY_DEFINITIONS``)
HOVER_TIME: Final = 3.0  # s, of a drone that nothing takes over; the core needs 2 s at most
DESCENT_SPEED: Final = 0.3  # m/s, of such a drone after that
DESCENT_MARGIN: Final = 0.2  # m below the floor, at which its descent ends
MAX_ROTATION: Final = math.radians(30)  # from the upload: heading drift is smaller


class TrajectoryMemory:
    """Trajectories stored one after the other in the memory of each drone, numbered from 0.

    Each ends with a descent, which begins `HOVER_TIME` after it, if there is room for these.

    Args:
        trajectories: All of them, without duplicates.
        depth: Of the descents, m; None for none.

    Attributes:
        depth: Of the descents, m; None if there are none.
        size: Bytes that are used.
    """

    def __init__(self, trajectories: Sequence[Trajectory] = (), depth: float | None = None) -> None:
        counts = [len(trajectory.duration) for trajectory in trajectories]
        if (pieces := sum(counts)) > MAX_PIECES:
            raise PluginError(
                f"{len(counts)} trajectories have {pieces} pieces of {PIECE} bytes, "
                f"{pieces * PIECE} bytes in all; a Crazyflie has {SIZE} bytes for them: "
                f"{MAX_PIECES} pieces at most",
                "memory-full",
            )
        if len(counts) > MAX_TRAJECTORIES:
            raise PluginError(
                f"a Crazyflie stores {MAX_TRAJECTORIES} trajectories at most, got {len(counts)}",
                "memory-full",
            )
        extended = [count + _DESCENT_PIECES for count in counts]
        self.depth = depth if sum(extended) <= MAX_PIECES else None
        if self.depth is not None:
            counts = extended
        self.size = PIECE * sum(counts)
        begins = accumulate(counts, initial=0)
        self._numbers = {trajectory: i for i, trajectory in enumerate(trajectories)}
        self._at = [PIECE * begin for begin, _ in zip(begins, counts, strict=False)]

    def __len__(self) -> int:
        return len(self._numbers)

    def upload(self, write: Callable[..., None], heading: float) -> None:
        """Upload all to a drone, rotated to its odometry frame.

        Args:
            write: Uploads one trajectory to the drone; `Vehicle.upload`.
            heading: Heading of the drone at the start, rad in the map frame.
        """
        for trajectory, number in self._numbers.items():
            turned = transformed(trajectory.coefficients, -heading)
            written = Trajectory(trajectory.duration, turned)
            if self.depth is not None:
                written = with_descent(written, self.depth)
            write(number, written, at=self._at[number])

    def start(self, trajectory: Trajectory | None, duration: float, version: int) -> bytes:
        """Return the packet that starts a trajectory of `duration`, s, at the current position."""
        if trajectory is None or trajectory not in self._numbers:
            raise ContractError("Command.trajectory was not uploaded")
        stretch = duration / float(trajectory.duration.sum())
        number = self._numbers[trajectory]
        return orders.start_trajectory(number, version, stretch=stretch, relative=True)

    def descent_time(self, trajectory: Trajectory, duration: float) -> float:
        """Return how long after a trajectory of `duration`, s, a drone is down, s.

        The hover and the descent are stretched as the trajectory is. Infinite without them.
        """
        if self.depth is None:
            return math.inf
        return duration / float(trajectory.duration.sum()) * come_down_time(self.depth)


def come_down_time(depth: float) -> float:
    """Return how long a hover and a descent by `depth`, m, take, s."""
    return HOVER_TIME + depth / DESCENT_SPEED


def with_descent(trajectory: Trajectory, depth: float) -> Trajectory:
    """Return a trajectory with a hover of `HOVER_TIME` and a straight descent by `depth`, m."""
    pieces = np.zeros((_DESCENT_PIECES, *trajectory.coefficients.shape[1:]))
    pieces[:, :, 0] = trajectory.end
    pieces[-1, 2, 1] = -DESCENT_SPEED
    times = [HOVER_TIME, depth / DESCENT_SPEED]
    return Trajectory(
        np.concatenate([trajectory.duration, times]),
        np.concatenate([trajectory.coefficients, pieces]),
    )


def rotation_error(yaw: float, heading: float) -> str:
    """Return why a trajectory cannot be flown at a rotation, '' if it matches the uploaded one.

    Args:
        yaw: Requested rotation in the odometry frame, rad.
        heading: Heading of the drone at its start, rad.

    >>> rotation_error(-1.0, 1.1)
    ''
    >>> rotation_error(math.pi / 2, 0.0)
    'refuses to follow a trajectory rotated by 90°: it was uploaded without rotation'
    """
    rotation = wrap_angle(yaw + heading)
    if abs(rotation) <= MAX_ROTATION:
        return ""
    return (
        f"refuses to follow a trajectory rotated by {math.degrees(rotation):.0f}°: it was uploaded "
        "without rotation"
    )


def packed(trajectory: Trajectory) -> bytes:
    """Return a trajectory's pieces in the uncompressed format of the trajectory memory."""
    coefficients = trajectory.coefficients.reshape(len(trajectory.duration), -1)
    pieces = np.column_stack([coefficients, trajectory.duration])
    return pieces.astype("<f4").tobytes()


def upload(number: int, trajectory: Trajectory, ask: Ask, *, at: int = 0) -> None:
    """Write a trajectory to a drone's memory, from byte `at` on, and assign it a number.

    Takes about 0.1 s per piece over radio.
    """
    writes = packets.write_memory(memory_number(ask), at, packed(trajectory))
    answers = ask([Question.of(write, write[1:6], "the trajectory memory") for write in writes])
    for i, answer in enumerate(answers):
        if answer[5:6] != b"\0":
            byte = at + i * packets.MEMORY_PIECE
            raise PluginError(
                f"byte {byte} of the trajectory memory is refused: {answer[5:].hex()!r}",
                "refused-request",
            )
    packet = orders.define_trajectory(number, len(trajectory.duration), at)
    (answer,) = ask([Question.of(packet, packet[1:4], f"trajectory {number}")])
    if answer[3:4] != b"\0":
        text = f"trajectory {number} is refused: error {answer[3:].hex()!r}"
        raise PluginError(text, "refused-request")


def memory_number(ask: Ask) -> int:
    """Return the number of the trajectory memory.

    Raises:
        PluginError: There is none.
    """
    about = "its memories"
    packet = packets.packet(packets.MEMORY, packets.MEMORY_INFO, b"\1")
    (answer,) = ask([Question.of(packet, b"\1", about)])
    infos = [packets.memory_info(number) for number in range(answer[1])]
    for number, info in enumerate(
        ask([Question.of(packet, packet[1:3], about) for packet in infos])
    ):
        if info[2:3] == bytes([TRAJECTORY_MEMORY]):
            return number
    raise PluginError("its firmware has no memory for trajectories", "outdated-firmware")
