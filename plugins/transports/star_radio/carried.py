"""Which trajectories the drones carry, where in their memories, and how one is begun."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate
from typing import Final

import numpy as np

from star_core import Array, ContractError, PluginError, Trajectory
from star_radio import orders
from star_radio.trajectory import MOST_PIECES, PIECE, SIZE, Piece
from star_radio.vehicle import Vehicle

MOST: Final = 10  # trajectories that the firmware can name (``NUM_TRAJECTORY_DEFINITIONS``)
TURNED: Final = math.radians(30)  # from how it was uploaded: more is meant, and no drift


class Carried:
    """Trajectories that share the memory of each drone: one after the other, numbered from 0.

    Args:
        trajectories: All of them, each once.

    Raises:
        PluginError: They do not fit.
    """

    def __init__(self, trajectories: Sequence[Trajectory] = ()) -> None:
        counts = [len(trajectory.duration) for trajectory in trajectories]
        if (pieces := sum(counts)) > MOST_PIECES:
            raise PluginError(
                f"{len(counts)} trajectories have {pieces} pieces of {PIECE} bytes, "
                f"{pieces * PIECE} bytes in all; a Crazyflie has {SIZE} bytes for them: "
                f"{MOST_PIECES} pieces at most"
            )
        if len(counts) > MOST:
            raise PluginError(f"a Crazyflie knows {MOST} trajectories at most, got {len(counts)}")
        begins = accumulate(counts, initial=0)
        self._numbers = {trajectory: i for i, trajectory in enumerate(trajectories)}
        self._at = [PIECE * begin for begin, _ in zip(begins, counts, strict=False)]

    def __contains__(self, trajectory: object) -> bool:
        return trajectory in self._numbers

    def upload(self, vehicle: Vehicle, heading: float) -> None:
        """Upload all to a drone, as they lie where it looked along `heading`, rad, at its start.

        Raises:
            PluginError: The drone refuses, or does not answer.
        """
        for trajectory, number in self._numbers.items():
            vehicle.upload(number, turned(trajectory, -heading), at=self._at[number])

    def start(self, trajectory: Trajectory | None, duration: float, version: int) -> bytes:
        """Return the packet that has a drone fly a trajectory in `duration`, s, from where it is.

        Raises:
            ContractError: It was not uploaded.
        """
        if trajectory is None or trajectory not in self:
            raise ContractError("Command.trajectory was not uploaded")
        stretch = duration / float(trajectory.duration.sum())
        number = self._numbers[trajectory]
        return orders.start_trajectory(number, version, stretch=stretch, relative=True)


def turned(trajectory: Trajectory, turn: float) -> list[Piece]:
    """Return a trajectory's pieces, turned by `turn`, rad, about the origin."""
    cos, sin = math.cos(turn), math.sin(turn)
    x, y, z, yaw = np.moveaxis(trajectory.coefficients, 1, 0)
    table: Array = np.stack([cos * x - sin * y, sin * x + cos * y, z, yaw], axis=1)
    table[:, 3, 0] += turn
    return list(map(Piece, table, trajectory.duration.tolist()))


def misfit(yaw: float, heading: float) -> str:
    """Say that a trajectory is to lie otherwise than it was uploaded; nothing if it is not.

    Args:
        yaw: By how much it is to be turned in the odometry frame, rad.
        heading: Of the drone at its start, rad.

    >>> misfit(-1.0, 1.1)
    ''
    >>> misfit(math.pi / 2, 0.0)
    'refuses to follow a trajectory: it is to be turned by 90°, and was uploaded as it is'
    """
    off = math.remainder(yaw + heading, math.tau)
    if abs(off) <= TURNED:
        return ""
    return (
        f"refuses to follow a trajectory: it is to be turned by {math.degrees(off):.0f}°, and was "
        "uploaded as it is"
    )
