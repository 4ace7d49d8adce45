"""Instructions for one tick: goals and commands, to which each stage adds."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from star_core.contracts import Status, TaskOutput
from star_core.errors import CommandError, ContractError
from star_core.messages.arrays import (
    Array,
    Mask,
    Rows,
    every,
    require_type,
    some,
)
from star_core.messages.commands import Command, Trajectory
from star_core.messages.state import Estimate, Goals

NUMBERS: Final = ("position", "velocity", "yaw", "speed")
"""Columns of `Goals` that are numbers."""


class GoalDraft:
    """Goals that the stages of a tick change.

    Attributes:
        position: (N, 3) m, map frame.
        active: (N,) agents with a goal.
    """

    def __init__(self, goals: Goals) -> None:
        self.position = goals.position.copy()
        self.active = goals.active.copy()
        self._velocity, self._yaw = goals.velocity.copy(), goals.yaw.copy()
        self._speed = goals.speed.copy()
        self._acceleration: Array | None = goals.acceleration
        self._yaw_rate: Array | None = goals.yaw_rate

    def stop(self) -> None:
        """Let all goals be at rest."""
        self._velocity.fill(0.0)
        self._acceleration = self._yaw_rate = None

    def set(self, row: int, position: Array, yaw: float, speed: float) -> None:
        """Set the goal of one agent, at rest."""
        self.position[row], self._velocity[row] = position, 0.0
        self._yaw[row], self._speed[row], self.active[row] = yaw, speed, True

    def take(self, goals: Goals, rows: Rows) -> None:
        """Take over the goals of some agents, in the order of their rows."""
        some_or_all: Rows | slice = rows if len(rows) < len(self.active) else slice(None)
        self.position[some_or_all] = goals.position[some_or_all]
        self._velocity[some_or_all] = goals.velocity[some_or_all]
        self._yaw[some_or_all] = goals.yaw[some_or_all]
        self._speed[some_or_all] = goals.speed[some_or_all]
        self.active[some_or_all] = True
        self._acceleration = merged(self._acceleration, goals.acceleration, some_or_all)
        self._yaw_rate = merged(self._yaw_rate, goals.yaw_rate, some_or_all)

    def hold(self, rows: Mask, estimate: Estimate, speed: float) -> None:
        """Set the goals of some agents, (N,), to their positions."""
        if not some(rows):
            return
        self.position[rows], self._yaw[rows] = estimate.position[rows], estimate.yaw[rows]
        self._speed[rows], self.active[rows] = speed, True

    def goals(self) -> Goals:
        """Return the goals as they are now."""
        return Goals(self.position, self._velocity, self._yaw, self._speed, self.active)

    def finish(self) -> Goals:
        """Return the goals, which do not change any more."""
        return Goals.made(
            self.position,
            self._velocity,
            self._yaw,
            self._speed,
            self.active,
            self._acceleration,
            self._yaw_rate,
        )


def merged(column: Array | None, other: Array | None, rows: Rows | Mask | slice) -> Array | None:
    """Return an optional column of goals or setpoints with some rows of another."""
    if column is None and other is None:
        return None
    if column is None:
        both: Array = np.full_like(other, np.nan)
    else:
        both = column.copy()
    both[rows] = np.nan if other is None else other[rows]
    return both


@dataclass(slots=True)
class Instructions:
    """Goals and commands of the swarm for one tick, which its stages add to.

    Attributes:
        goals: Of all agents; they persist from tick to tick.
        commands: To send, in this order.
        doing: The running steps.
        leave: Agents that are to land and leave the mission.
        free: Agents whose step is over or that left it: what they fly on board is aborted.
        parameters: Of agents' firmware to set: rows and values of each step that sets some.
    """

    goals: GoalDraft
    commands: list[Command] = field(default_factory=list)
    doing: list[str] = field(default_factory=list)
    leave: set[int] = field(default_factory=set)
    free: set[int] = field(default_factory=set)
    parameters: list[tuple[tuple[int, ...], Mapping[str, float]]] = field(default_factory=list)

    def add(
        self,
        answer: object,
        members: Mask,
        trajectories: Collection[Trajectory] = (),
        check: GoalCheck | None = None,
    ) -> TaskOutput:
        """Merge a task's output, which may be about its own agents only, and return it.

        Args:
            answer: The output.
            members: (N,) the task's agents.
            trajectories: Those that have been uploaded.
            check: Of the task's goals.

        Raises:
            ContractError: It is no `TaskOutput`, is about others, has another number of rows, is
                not finite, or orders a trajectory that was not uploaded.
        """
        output = require_type(answer, TaskOutput)
        if not isinstance(output.status, Status):
            raise ContractError(f"TaskOutput.status is {output.status!r}, expected a Status")
        for command in output.commands:
            _check_command(require_type(command, Command), members, trajectories)
        if output.goals is not None:
            goals = require_type(output.goals, Goals)
            self.goals.take(goals, (check or GoalCheck()).rows(goals, members))
        self.commands += output.commands
        if output.parameters is not None:
            _check_parameters(output.parameters)
            self.parameters.append((tuple(np.flatnonzero(members).tolist()), output.parameters))
        return output


def _check_parameters(parameters: Mapping[str, float]) -> None:
    """Check that parameters of firmware are numbers."""
    if not all(map(math.isfinite, parameters.values())):
        raise ContractError(f"TaskOutput.parameters is {parameters!r}, expected numbers")


class GoalCheck:
    """Checks the goals of a task, but not those that it returns again: tables do not change."""

    def __init__(self) -> None:
        self._goals: Goals | None = None
        self._members: Mask | None = None
        self._rows: Rows

    def rows(self, goals: Goals, members: Mask) -> Rows:
        """Return the rows of the agents that have goals, which may be `members`, (N,), only."""
        if goals is not self._goals or members is not self._members:
            self._rows = _checked_rows(goals, members)
            self._goals, self._members = goals, members
        return self._rows


def _checked_rows(goals: Goals, members: Mask) -> Rows:
    """Return the rows of the agents that have goals."""
    require_type(goals, Goals, len(members))
    if some(goals.active > members):
        raise ContractError("has goals for agents that are not its own")
    rows = np.flatnonzero(goals.active)
    for name in NUMBERS:
        finite = np.isfinite(getattr(goals, name))
        if not every(finite) and not every(finite[rows]):
            values = getattr(goals, name)[rows].tolist()
            raise ContractError(f"Goals.{name} is {values!r}, expected numbers")
    if some(goals.active & (goals.speed < 0)):
        raise ContractError(f"Goals.speed is {goals.speed.tolist()!r}, expected 0 or more")
    return rows


def _check_command(command: Command, members: Mask, trajectories: Collection[Trajectory]) -> None:
    agents, rows = command.agent.tolist(), np.flatnonzero(members).tolist()
    if not set(agents) <= set(rows):
        raise CommandError(f"commands agents {agents!r}, its own are {tuple(rows)!r}")
    if command.trajectory is not None and command.trajectory not in trajectories:
        raise CommandError(
            "orders a trajectory that no task had among its trajectories before take-off"
        )
