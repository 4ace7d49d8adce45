"""What a `Command` asks of each drone: whether it makes sense, in words, and as packets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from star_core import Command, ContractError, Order
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


def check(command: Command) -> None:
    """Refuse a command that makes no sense.

    Raises:
        ContractError: A duration is not positive, or a target is not finite.
    """
    if command.order in {Order.ARM, Order.STOP}:
        return
    if not (command.duration > 0).all():
        raise ContractError(f"Command.duration must be positive, got {command.duration!r}")
    turning = command.order in {Order.GOTO, Order.FOLLOW}
    used = command.position if turning else command.position[:, 2]
    if not np.isfinite(used).all():
        raise ContractError(f"Command.position must be finite, got {command.position!r}")
    if turning and not np.isfinite(command.yaw).all():
        raise ContractError(f"Command.yaw must be finite, got {command.yaw!r}")
