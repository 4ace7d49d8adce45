"""Conversion of a `Command` to packets, and the names of commands for messages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from star_core import Command, Order
from star_radio import orders
from star_radio.trajectory_memory import TrajectoryMemory

NAMES: Final = {
    Order.TAKEOFF: "take off",
    Order.LAND: "land",
    Order.GOTO: "go to a position",
    Order.FOLLOW: "follow a trajectory",
    Order.STOP: "stop",
}


def packet(command: Command, i: int, version: int, memory: TrajectoryMemory) -> bytes:
    """Return the packet of one row of a command.

    Args:
        command: Any but ARM.
        i: Row of the command.
        version: Protocol version of the drone.
        memory: The uploaded trajectories.

    Raises:
        ContractError: The trajectory to follow was not uploaded.
    """
    position = command.position[i].tolist()
    duration = float(command.duration[i])
    make: Callable[[], bytes] = {
        Order.TAKEOFF: lambda: orders.takeoff(position[2], duration),
        Order.LAND: lambda: orders.land(position[2], duration),
        Order.GOTO: lambda: orders.go_to(position, float(command.yaw[i]), duration, version),
        Order.FOLLOW: lambda: memory.start(command.trajectory, duration, version),
        Order.STOP: orders.stop,
    }[command.order]
    return make()
