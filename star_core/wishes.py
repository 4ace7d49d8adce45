"""What the running steps of a mission want in one tick, merged."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from star_core.conformance import expect
from star_core.contracts import Step
from star_core.errors import ContractError
from star_core.swarm import Command, Goals, Order
from star_core.table import Array, Mask

NUMBERED: Final = (Order.TAKEOFF, Order.LAND, Order.GOTO)
"""Orders that say where and how fast."""


@dataclass(slots=True)
class Wishes:
    """What the running steps want in one tick, merged.

    Attributes:
        position: (N, 3) goals so far, m, map frame; the other fields are as in `Goals`.
        commands: Orders of this tick.
        doing: The steps under way.
        leave: Agents that are to land and leave the mission.
    """

    position: np.ndarray
    velocity: np.ndarray
    yaw: np.ndarray
    speed: np.ndarray
    active: Mask
    commands: list[Command] = field(default_factory=list)
    doing: list[str] = field(default_factory=list)
    leave: set[int] = field(default_factory=set)

    @classmethod
    def none(cls, n: int) -> Wishes:
        """Nothing wanted of `n` agents."""
        return cls(
            np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n), np.zeros(n), np.zeros(n, np.bool_)
        )

    def fresh(self) -> None:
        """Begin another tick: goals stay where they are, and stand still."""
        self.velocity[:] = 0.0
        self.commands, self.doing, self.leave = [], [], set()

    def add(self, step: Step, own: Mask) -> None:
        """Merge a task's answer, which may speak for its own rows only, (N,).

        Raises:
            ContractError: It speaks for others, has another number of rows, or is not finite.
        """
        for command in step.commands:
            agents, rows = expect(command, Command).agent.tolist(), np.flatnonzero(own).tolist()
            if not set(agents) <= set(rows):
                raise ContractError(f"commands agents {agents!r}, its own are {tuple(rows)!r}")
            for name in ("position", "yaw", "duration") if command.order in NUMBERED else ():
                values = getattr(command, name)
                if not np.isfinite(values).all():
                    raise ContractError(f"Command.{name} is {values.tolist()!r}, expected numbers")
            self.commands.append(command)
        if step.goals is None:
            return
        goals = expect(step.goals, Goals)
        if (n := len(goals.active)) != len(own):
            raise ContractError(f"Goals.position has {n} rows, expected {len(own)}")
        if (goals.active > own).any():
            raise ContractError("has goals for agents that are not its own")
        about = np.flatnonzero(goals.active)
        for name in ("position", "velocity", "yaw", "speed"):
            values = getattr(goals, name)[about]
            if not np.isfinite(values).all():
                raise ContractError(f"Goals.{name} is {values.tolist()!r}, expected numbers")
            getattr(self, name)[about] = values
        self.active[about] = True

    def send(self, row: int, position: Array, yaw: float, speed: float) -> None:
        """Give one agent a goal of the core's own."""
        self.position[row], self.velocity[row] = position, 0.0
        self.yaw[row], self.speed[row], self.active[row] = yaw, speed, True

    def goals(self) -> Goals:
        """The merged goals as a table."""
        return Goals(self.position, self.velocity, self.yaw, self.speed, self.active)
