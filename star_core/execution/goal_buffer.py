"""Goals and commands of all running steps in one tick, merged."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from star_core.contracts import TaskOutput
from star_core.errors import ContractError
from star_core.messages.arrays import Array, Mask, require_rows, require_type
from star_core.messages.commands import Command, Trajectory
from star_core.messages.state import Estimate, Goals


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
        self.velocity[:] = 0.0
        self.commands: list[Command] = []
        self.doing: list[str] = []
        self.leave: set[int] = set()
        self.free: set[int] = set()

    def add(self, output: TaskOutput, own: Mask) -> None:
        """Merge a task's output, which may be about its own agents only, (N,).

        Raises:
            ContractError: It is about others, has another number of rows, is not finite, or orders
                a trajectory that was not uploaded.
        """
        for command in output.commands:
            self._check(require_type(command, Command), own)
            self.commands.append(command)
        if output.goals is None:
            return
        goals = require_type(output.goals, Goals)
        require_rows(goals, len(goals.active), len(own))
        if (goals.active > own).any():
            raise ContractError("has goals for agents that are not its own")
        rows = np.flatnonzero(goals.active)
        for name in ("position", "velocity", "yaw", "speed"):
            values = getattr(goals, name)[rows]
            if not np.isfinite(values).all():
                raise ContractError(f"Goals.{name} is {values.tolist()!r}, expected numbers")
            getattr(self, name)[rows] = values
        if (goals.speed[rows] < 0).any():
            raise ContractError(f"Goals.speed is {goals.speed.tolist()!r}, expected 0 or more")
        self.active[rows] = True

    def set_goal(self, row: int, position: Array, yaw: float, speed: float) -> None:
        """Set the goal of one agent, at rest."""
        self.position[row], self.velocity[row] = position, 0.0
        self.yaw[row], self.speed[row], self.active[row] = yaw, speed, True

    def hold(self, flying: Mask, estimate: Estimate) -> None:
        """Set the goals of flying agents, (N,), without a goal to their positions."""
        rows = flying & ~self.active
        if not rows.any():
            return
        self.position[rows] = estimate.position[rows]
        self.yaw[rows] = estimate.yaw[rows]
        self.speed[rows] = self._speed_limit
        self.active[rows] = True

    def goals(self) -> Goals:
        """Return the merged goals as a table."""
        return Goals(self.position, self.velocity, self.yaw, self.speed, self.active)

    def _check(self, command: Command, own: Mask) -> None:
        agents, rows = command.agent.tolist(), np.flatnonzero(own).tolist()
        if not set(agents) <= set(rows):
            raise ContractError(f"commands agents {agents!r}, its own are {tuple(rows)!r}")
        if command.trajectory is not None and command.trajectory not in self._trajectories:
            raise ContractError(
                "orders a trajectory that no task had among its trajectories before take-off"
            )
