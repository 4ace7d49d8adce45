"""Commands to on-board high-level commanders."""

from __future__ import annotations

from enum import StrEnum
from typing import Final

import numpy as np

from star_core.errors import ContractError
from star_core.messages.arrays import Array, Mask, Rows, Table, column, table


class Order(StrEnum):
    """Kind of a command to an on-board high-level commander."""

    ARM = "arm"
    TAKEOFF = "takeoff"  # climb straight up to position z
    LAND = "land"  # descend straight down to position z
    GOTO = "goto"  # fly to position
    FOLLOW = "follow"  # fly a trajectory that was uploaded
    STOP = "stop"  # motors off, at once


PIECE: Final = (4, 8)  # axes of a trajectory: x, y, z and yaw; coefficients of each


@table(per="piece", eq=False)
class Trajectory(Table):
    """A trajectory of polynomial pieces, in a frame of its own; compared by value.

    Attributes:
        duration: Of each piece, s.
        coefficients: Of x, y and z, m, and of yaw, rad, over the time since the piece
            began, s: the constant first.
    """

    duration: Array = column()
    coefficients: Array = column(*PIECE)

    def __post_init__(self) -> None:
        Table.__post_init__(self)  # `slots` makes another class, which breaks `super()`
        if not (
            len(self.duration) and np.isfinite(self.duration).all() and (self.duration > 0).all()
        ):
            raise ContractError(
                f"Trajectory.duration is {self.duration.tolist()!r}, expected one or more numbers "
                "above 0"
            )
        if not np.isfinite(self.coefficients).all():
            raise ContractError("Trajectory.coefficients are not all finite")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Trajectory) and self._numbers == other._numbers

    def __hash__(self) -> int:
        return hash(self._numbers)

    @property
    def end(self) -> Array:
        """(4,) x, y and z, m, and yaw, rad, at its end."""
        powers = self.duration[-1] ** np.arange(PIECE[1])
        end: Array = self.coefficients[-1] @ powers
        return end

    @property
    def _numbers(self) -> bytes:
        return self.duration.tobytes() + self.coefficients.tobytes()


@table(per="agent commanded")
class Command(Table):
    """A command to the on-board commanders of some agents: one row per agent.

    Attributes:
        order: Kind of the command.
        agent: Rows of the agents.
        position: Target, m: in the map when a task gives it, in each agent's odometry frame
            when a transport receives it. Take-off and landing use z only, x and y may be NaN.
            For FOLLOW it is the origin of the trajectory's frame.
        yaw: Heading at the end, rad, in the same frame. Take-off and landing keep theirs. For
            FOLLOW it is the rotation of the trajectory's frame.
        duration: s. A trajectory is flown as much slower as this is longer than its own.
        trajectory: To FOLLOW: one of those that were uploaded. None with any other order.

    Raises:
        ContractError: A duration is not above 0, or a number that is used is not finite.
    """

    order: Order
    agent: Rows = column()
    position: Array = column(3)
    yaw: Array = column()
    duration: Array = column()
    trajectory: Trajectory | None = None

    def __post_init__(self) -> None:
        Table.__post_init__(self)
        if not isinstance(self.order, Order):
            raise ContractError(f"Command.order is {self.order!r}, expected an Order")
        follows = self.order is Order.FOLLOW
        if follows is not isinstance(self.trajectory, Trajectory):
            expected = "a Trajectory" if follows else "None"
            raise ContractError(
                f"Command.trajectory of the order {str(self.order)!r} is "
                f"{type(self.trajectory).__name__}, expected {expected}"
            )
        if self.order in {Order.ARM, Order.STOP}:
            return
        turns = follows or self.order is Order.GOTO
        lasts = np.isfinite(self.duration) & (self.duration > 0)
        self._expect("duration", self.duration, "more than 0", lasts)
        self._expect("position", self.position, "numbers", np.isfinite(self.position[:, 2]))
        if turns:
            self._expect("position", self.position, "numbers", np.isfinite(self.position))
            self._expect("yaw", self.yaw, "numbers", np.isfinite(self.yaw))

    def end(self) -> Array:
        """Return (K, 3) where a flight on board ends, m; x and y of take-offs are NaN."""
        end = self.position.copy()
        if self.order is Order.TAKEOFF:
            end[:, :2] = np.nan
        elif self.trajectory is not None:
            x, y, z, _yaw = self.trajectory.end
            cos, sin = np.cos(self.yaw), np.sin(self.yaw)
            end += np.column_stack([cos * x - sin * y, sin * x + cos * y, np.full(len(end), z)])
        return end

    def _expect(self, name: str, values: Array, what: str, so: Mask) -> None:
        if not so.all():
            raise ContractError(f"Command.{name} is {values.tolist()!r}, expected {what}")
