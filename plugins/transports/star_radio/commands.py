"""What a `Command` asks of each drone: in words, and as packets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from star_core import Command, Order
from star_radio import orders
from star_radio.carried import Carried

WORDS: Final = {
    Order.TAKEOFF: "take off",
    Order.LAND: "land",
    Order.GOTO: "go to a place",
    Order.FOLLOW: "follow a trajectory",
    Order.STOP: "stop",
}


def packet(command: Command, i: int, version: int, carried: Carried) -> bytes:
    """Return the packet of one row of a command.

    Args:
        command: Any but ARM.
        i: Which row of it.
        version: Of the protocol that the drone speaks.
        carried: The trajectories that it has.

    Raises:
        ContractError: It is to follow one that it has not.
    """
    position = command.position[i].tolist()
    duration = float(command.duration[i])
    make: Callable[[], bytes] = {
        Order.TAKEOFF: lambda: orders.takeoff(position[2], duration),
        Order.LAND: lambda: orders.land(position[2], duration),
        Order.GOTO: lambda: orders.go_to(position, float(command.yaw[i]), duration, version),
        Order.FOLLOW: lambda: carried.start(command.trajectory, duration, version),
        Order.STOP: orders.stop,
    }[command.order]
    return make()
