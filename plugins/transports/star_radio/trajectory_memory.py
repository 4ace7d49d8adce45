"""Trajectories in the drones' memories: their layout, upload and start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate
from typing import Final

from star_core import ContractError, PluginError, Trajectory, transformed, wrap_angle
from star_radio import orders
from star_radio.trajectory import MOST_PIECES, PIECE, SIZE
from star_radio.vehicle import Vehicle

MAX_TRAJECTORIES: Final = 10  # of the firmware (``NUM_TRAJECTORY_DEFINITIONS``)
MAX_ROTATION: Final = math.radians(30)  # from the upload: heading drift is smaller


class TrajectoryMemory:
    """Trajectories stored one after the other in the memory of each drone, numbered from 0.

    Args:
        trajectories: All of them, without duplicates.

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
        if len(counts) > MAX_TRAJECTORIES:
            raise PluginError(
                f"a Crazyflie stores {MAX_TRAJECTORIES} trajectories at most, got {len(counts)}"
            )
        begins = accumulate(counts, initial=0)
        self._numbers = {trajectory: i for i, trajectory in enumerate(trajectories)}
        self._at = [PIECE * begin for begin, _ in zip(begins, counts, strict=False)]

    def __contains__(self, trajectory: object) -> bool:
        return trajectory in self._numbers

    def upload(self, vehicle: Vehicle, heading: float) -> None:
        """Upload all to a drone, rotated to its odometry frame.

        Args:
            vehicle: The drone.
            heading: Its heading at the start, rad in the map frame.

        Raises:
            PluginError: The drone refuses or does not answer.
        """
        for trajectory, number in self._numbers.items():
            turned = transformed(trajectory.coefficients, -heading)
            vehicle.upload(number, Trajectory(trajectory.duration, turned), at=self._at[number])

    def start(self, trajectory: Trajectory | None, duration: float, version: int) -> bytes:
        """Return the packet that starts a trajectory of `duration`, s, at the current position.

        Raises:
            ContractError: It was not uploaded.
        """
        if trajectory is None or trajectory not in self:
            raise ContractError("Command.trajectory was not uploaded")
        stretch = duration / float(trajectory.duration.sum())
        number = self._numbers[trajectory]
        return orders.start_trajectory(number, version, stretch=stretch, relative=True)


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
