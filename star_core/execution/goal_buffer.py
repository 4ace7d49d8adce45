"""What the running steps of a mission want in one tick, merged."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from star_core.contracts import TaskOutput
from star_core.errors import ContractError
from star_core.messages.arrays import Array, Mask
from star_core.messages.commands import Command, Trajectory
from star_core.messages.state import Estimate, Goals
from star_core.messages.validation import expect_rows, require_type


@dataclass(slots=True)
class GoalBuffer:
    """What the running steps want in one tick, merged.

    Attributes:
        position: (N, 3) goals so far, m, map frame; the other fields are as in `Goals`.
        commands: Orders of this tick.
        doing: The steps under way.
        leave: Agents that are to land and leave the mission.
        free: Agents whose step is over or theirs no more: what they fly on their own is void.
        uploaded: Trajectories that can be ordered, in every tick.
        speed_limit: Of agents that hold their position, m/s.
    """

    position: np.ndarray
    velocity: np.ndarray
    yaw: np.ndarray
    speed: np.ndarray
    active: Mask
    commands: list[Command] = field(default_factory=list)
    doing: list[str] = field(default_factory=list)
    leave: set[int] = field(default_factory=set)
    free: set[int] = field(default_factory=set)
    uploaded: Collection[Trajectory] = ()
    speed_limit: float = 0.0

    @classmethod
    def none(cls, n: int, speed_limit: float) -> GoalBuffer:
        """No goal for any of `n` agents."""
        zero = np.zeros(n)
        return cls(
            np.zeros((n, 3)),
            np.zeros((n, 3)),
            zero.copy(),
            zero.copy(),
            np.zeros(n, np.bool_),
            speed_limit=speed_limit,
        )

    def fresh(self) -> None:
        """Begin another tick: goals stay where they are, and stand still."""
        self.velocity[:] = 0.0
        self.commands, self.doing, self.leave, self.free = [], [], set(), set()

    def add(self, step: TaskOutput, own: Mask) -> None:
        """Merge a task's answer, which may speak for its own rows only, (N,).

        Raises:
            ContractError: It speaks for others, has another number of rows, is not finite, or
                orders what was not uploaded.
        """
        for command in step.commands:
            self._check(require_type(command, Command), own)
            self.commands.append(command)
        if step.goals is None:
            return
        goals = require_type(step.goals, Goals)
        expect_rows(goals, len(goals.active), len(own))
        if (goals.active > own).any():
            raise ContractError("has goals for agents that are not its own")
        about = np.flatnonzero(goals.active)
        for name in ("position", "velocity", "yaw", "speed"):
            values = getattr(goals, name)[about]
            if not np.isfinite(values).all():
                raise ContractError(f"Goals.{name} is {values.tolist()!r}, expected numbers")
            getattr(self, name)[about] = values
        if (goals.speed[about] < 0).any():
            raise ContractError(f"Goals.speed is {goals.speed.tolist()!r}, expected 0 or more")
        self.active[about] = True

    def send(self, row: int, position: Array, yaw: float, speed: float) -> None:
        """Give one agent a goal of the core's own."""
        self.position[row], self.velocity[row] = position, 0.0
        self.yaw[row], self.speed[row], self.active[row] = yaw, speed, True

    def hold(self, flying: Mask, estimate: Estimate) -> None:
        """Give agents in flight that have no goal their position as their goal: (N,)."""
        rows = flying & ~self.active
        if not rows.any():
            return
        self.position[rows] = estimate.position[rows]
        self.yaw[rows] = estimate.yaw[rows]
        self.speed[rows] = self.speed_limit
        self.active[rows] = True

    def goals(self) -> Goals:
        """The merged goals as a table."""
        return Goals(self.position, self.velocity, self.yaw, self.speed, self.active)

    def _check(self, command: Command, own: Mask) -> None:
        agents, rows = command.agent.tolist(), np.flatnonzero(own).tolist()
        if not set(agents) <= set(rows):
            raise ContractError(f"commands agents {agents!r}, its own are {tuple(rows)!r}")
        if command.trajectory is not None and command.trajectory not in self.uploaded:
            raise ContractError(
                "orders a trajectory that no task had among its trajectories before take-off"
            )
