"""The agents assigned to the slots of a mission, and the goals and commands of their steps."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from star_core.contracts import Status, TaskOutput
from star_core.errors import CommandError, ContractError
from star_core.messages.arrays import (
    Array,
    Mask,
    Rows,
    every,
    require_rows,
    require_type,
    some,
)
from star_core.messages.commands import Command, Trajectory
from star_core.messages.state import Estimate, Goals
from star_core.scene import Scene


@dataclass(frozen=True, slots=True)
class Team:
    """The agents of a step.

    Attributes:
        holders: The row of the agent assigned to each of the step's slots.
        rows: Their rows.
        own: (N,) whether an agent is one of them.
        label: Their names or their group's, for messages.
    """

    holders: Mapping[int, int]
    rows: tuple[int, ...]
    own: Mask
    label: str

    @classmethod
    def of(cls, holders: Mapping[int, int], scene: Scene) -> Team:
        """Return the agents assigned to some slots."""
        rows = tuple(holders.values())
        own = np.zeros(len(scene.agents), np.bool_)
        own[list(rows)] = True
        return cls(holders, rows, own, scene.label(rows))


class Assignments:
    """The slots of a mission and the agents assigned to them.

    A slot is numbered by the row of its first agent; steps are for slots. Another agent may be
    assigned to it, or none.

    Args:
        n: Number of agents.
        reserve: Rows of the agents that are in no step until they replace another or join.

    Attributes:
        retired: Slots that stay empty.
        version: Increases with each change.
    """

    def __init__(self, n: int, reserve: Iterable[int] = ()) -> None:
        self._holder = list(range(n))
        self._vacant = set(reserve)
        self.retired = set(reserve)
        self.version = 0

    def holders(self, slots: Iterable[int]) -> dict[int, int]:
        """Return the row of the agent of each of some slots, without the empty ones."""
        return {slot: self._holder[slot] for slot in slots if slot not in self._vacant}

    def slot(self, row: int) -> int | None:
        """Return the slot of an agent; None if it is not in the mission."""
        for slot, holder in enumerate(self._holder):
            if holder == row and slot not in self._vacant:
                return slot
        return None

    def vacancies(self) -> list[int]:
        """Return the empty slots that an agent should be assigned to."""
        return sorted(self._vacant - self.retired)

    def removed(self) -> Mask:
        """Return which agents have left the mission without reserves and cannot join it: (N,)."""
        removed = np.zeros(len(self._holder), np.bool_)
        removed[self.vacancies()] = True
        return removed

    def vacate(self, rows: Iterable[int], *, retire: bool = False) -> None:
        """Take agents out of the mission; with `retire`, their slots stay empty."""
        for row in rows:
            if (slot := self.slot(row)) is not None:
                self.version += 1
                self._vacant.add(slot)
                if retire:
                    self.retired.add(slot)

    def assign(self, slot: int, row: int) -> None:
        """Assign an agent to a slot, replacing its present one."""
        self.version += 1
        self._holder[slot] = row
        self._vacant.discard(slot)
        self.retired.discard(slot)

    def unassigned(self) -> Mask:
        """Return which agents are not in the mission: (N,)."""
        out = np.ones(len(self._holder), np.bool_)
        out[list(self.holders(range(len(self._holder))).values())] = False
        return out


class GoalBuffer:
    """Goals and commands of all running steps; goals persist from tick to tick.

    Args:
        n: Number of agents.
        speed_limit: Of agents that hold their position, m/s.
        trajectories: Those that have been uploaded.

    Attributes:
        position: (N, 3) goals, m, map frame.
        velocity: (N, 3) as in `Goals`, like the next three.
        yaw: (N,) rad.
        speed: (N,) m/s.
        active: (N,) agents with a goal.
        commands: Of this tick.
        doing: The running steps.
        leave: Agents that are to land and leave the mission.
        free: Agents whose step is over or that left it: what they fly on board is aborted.
    """

    def __init__(
        self, n: int, speed_limit: float, trajectories: Collection[Trajectory] = ()
    ) -> None:
        self.position = np.zeros((n, 3))
        self.velocity = np.zeros((n, 3))
        self.yaw = np.zeros(n)
        self.speed = np.zeros(n)
        self.active = np.zeros(n, np.bool_)
        self._speed_limit = speed_limit
        self._trajectories = trajectories
        self.begin_tick()

    def begin_tick(self) -> None:
        """Clear what is of one tick only; goals persist, at rest."""
        self.velocity.fill(0.0)
        self.commands: list[Command] = []
        self.doing: list[str] = []
        self.leave: set[int] = set()
        self.free: set[int] = set()

    def add(self, answer: object, own: Mask) -> TaskOutput:
        """Merge a task's output, which may be about its own agents only, (N,), and return it.

        Raises:
            ContractError: It is no `TaskOutput`, is about others, has another number of rows, is
                not finite, or orders a trajectory that was not uploaded.
        """
        output = require_type(answer, TaskOutput)
        if not isinstance(output.status, Status):
            raise ContractError(f"TaskOutput.status is {output.status!r}, expected a Status")
        for command in output.commands:
            self._check_command(require_type(command, Command), own)
        if output.goals is not None:
            goals = require_type(output.goals, Goals)
            rows = self._check_goals(goals, own)
            for name in ("position", "velocity", "yaw", "speed"):
                getattr(self, name)[rows] = getattr(goals, name)[rows]
            self.active[rows] = True
        self.commands += output.commands
        return output

    def set_goal(self, row: int, position: Array, yaw: float, speed: float) -> None:
        """Set the goal of one agent, at rest."""
        self.position[row], self.velocity[row] = position, 0.0
        self.yaw[row], self.speed[row], self.active[row] = yaw, speed, True

    def hold(self, flying: Mask, estimate: Estimate) -> None:
        """Set the goals of flying agents, (N,), without a goal to their positions."""
        rows = flying & ~self.active
        if not some(rows):
            return
        self.position[rows] = estimate.position[rows]
        self.yaw[rows] = estimate.yaw[rows]
        self.speed[rows] = self._speed_limit
        self.active[rows] = True

    def goals(self) -> Goals:
        """Return the merged goals as a table."""
        return Goals(self.position, self.velocity, self.yaw, self.speed, self.active)

    def _check_goals(self, goals: Goals, own: Mask) -> Rows:
        """Return the rows of the agents that have goals."""
        require_rows(goals, len(goals.active), len(own))
        if some(goals.active > own):
            raise ContractError("has goals for agents that are not its own")
        rows = np.flatnonzero(goals.active)
        for name in ("position", "velocity", "yaw", "speed"):
            values = getattr(goals, name)[rows]
            if not every(np.isfinite(values)):
                raise ContractError(f"Goals.{name} is {values.tolist()!r}, expected numbers")
        if some(goals.speed[rows] < 0):
            raise ContractError(f"Goals.speed is {goals.speed.tolist()!r}, expected 0 or more")
        return rows

    def _check_command(self, command: Command, own: Mask) -> None:
        agents, rows = command.agent.tolist(), np.flatnonzero(own).tolist()
        if not set(agents) <= set(rows):
            raise CommandError(f"commands agents {agents!r}, its own are {tuple(rows)!r}")
        if command.trajectory is not None and command.trajectory not in self._trajectories:
            raise CommandError(
                "orders a trajectory that no task had among its trajectories before take-off"
            )
