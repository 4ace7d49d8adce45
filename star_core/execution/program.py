"""What the program of a flight lets agents do: steps, goals, setpoints and commands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from star_core.errors import InputError, StarError, suggestion
from star_core.execution.assignments import Assignments
from star_core.execution.executor import StartedStep, StepExecutor
from star_core.execution.instructions import Instructions, merged
from star_core.messages.arrays import Rows, require_type, some
from star_core.messages.commands import Command
from star_core.messages.state import AgentPhase, Goals, Plan, Setpoint
from star_core.mission import Action, Mission, OnFailure
from star_core.plugin_support.option_schema import fill_defaults
from star_core.plugin_support.outputs import checked_goals, checked_setpoint
from star_core.plugin_support.registry import Found, Registry, guarded

FLIES = frozenset({AgentPhase.TAKING_OFF, AgentPhase.FLYING})


class Program:
    """Steps, goals, setpoints and commands that a program gives, and each agent's latest counts.

    An agent leaves the step that it is in when the program gives it something else.
    """

    def __init__(
        self,
        mission: Mission,
        registry: Registry,
        executor: StepExecutor,
        assignments: Assignments,
    ) -> None:
        n = len(mission.scene.agents)
        self._scene = mission.scene
        self._registry = registry
        self._executor = executor
        self._assignments = assignments
        self._number = len(mission.reactions)  # of the program that the agents followed last
        self._direct = np.zeros(n, np.bool_)  # agents that follow no step
        self._goals = Goals.none(n)
        self._setpoint = self._no_setpoint = Setpoint.none(n)
        self._commands: list[Command] = []
        self._free: set[int] = set()
        self._pending = False

    def start(
        self,
        action: Action,
        phase: Rows,
    ) -> StartedStep:
        """Start a step in the next tick; its agents leave the steps that they are in.

        Raises:
            StarError: An agent has left the mission, or is in the air or on the ground where the
                step needs it to be elsewhere.
        """
        before = self._registry.find("task", action.verb).offer.before
        names = self._scene.names
        slots = []
        for row in action.rows:
            slot = self._assignments.slot(row)
            if slot is None and row not in self._assignments.retired:
                raise StarError(f"{names[row]} has left the mission", "agent-not-in-mission")
            is_at = AgentPhase(int(phase[row]))
            if before is not None and (is_at in FLIES) != (before == "air"):
                state = is_at.name.lower().replace("_", " ")
                where = "in the air" if before == "air" else "on the ground"
                text = f"{action.verb}: {names[row]} is {state}, expected {where}"
                raise StarError(text, "wrong-airborne-state")
            slots.append(row if slot is None else slot)
        self._direct[list(action.rows)] = False
        self._number += 1
        return self._executor.start(replace(action, rows=tuple(slots)), self._number)

    def action(
        self,
        verb: str,
        agents: str | list[str] | tuple[str, ...] | None,
        options: Mapping[str, Any],
        *,
        timeout: float | None,
        on_failure: OnFailure,
        location: str,
    ) -> Action:
        """Return a step of a verb, checked.

        Raises:
            InputError: A name or an option is wrong.
            PluginError: There is no such verb, or several.
        """
        plugin = self._registry.find("task", verb)
        rows = self.rows(agents)
        filled = fill_defaults(options, plugin.offer.options)
        problems = [*self._problems(plugin, options)]
        problems = problems or [*self._checked(plugin, rows, filled)]
        if problems:
            raise InputError([f"{location}: {verb}: {problem}" for problem in problems])
        return Action(
            verb=verb,
            source=plugin.source,
            rows=rows,
            options=filled,
            until=None,
            timeout=timeout,
            on_failure=on_failure,
            location=location,
            written=dict(options),
        )

    def rows(self, agents: str | list[str] | tuple[str, ...] | None) -> tuple[int, ...]:
        """Return the rows of some agents or groups, each once; of all agents for None.

        Raises:
            InputError: There is no such agent or group.
        """
        groups = self._scene.rows_by_name
        names = ["all"] if agents is None else [agents] if isinstance(agents, str) else agents
        for name in names:
            if name not in groups:
                hint = suggestion(name, groups, "there are")
                raise InputError(f"no agent or group named {name!r}{hint}", "unknown-agent")
        return tuple(sorted({row for name in names for row in groups[name]}))

    def set_goals(self, goals: Goals) -> None:
        """Set goals of the active rows, as a task would: they persist, at rest after one tick."""
        self._goals = checked_goals(goals, len(self._direct))
        self._take_over(np.flatnonzero(goals.active))

    def set_setpoint(self, setpoint: Setpoint) -> None:
        """Set what the active rows fly in the next tick, instead of what the planner returns.

        Avoider and safety filter still change it. After that tick an agent holds its position.
        """
        self._setpoint = checked_setpoint(setpoint, len(self._direct))
        self._take_over(np.flatnonzero(setpoint.active))

    def send(self, command: Command) -> None:
        """Send a command to on-board commanders in the next tick."""
        self._commands.append(require_type(command, Command))
        self._take_over(command.agent)

    def step(self, instructions: Instructions) -> None:
        """Add what the program has set for its agents to the instructions of a tick."""
        if not self._pending:
            return
        present = ~self._assignments.unassigned
        instructions.goals.take(self._goals, np.flatnonzero(self._goals.active & present))
        instructions.goals.active[self._setpoint.active & present] = (
            False  # they hold where they are
        )
        instructions.commands += self._commands
        instructions.free |= self._free
        self._goals = Goals.none(len(present))
        self._commands, self._free, self._pending = [], set(), False

    def steer(self, plan: Plan) -> Plan:
        """Return a plan with the setpoints that the program has set for this tick."""
        if self._setpoint is self._no_setpoint:
            return plan
        rows = self._setpoint.active & ~self._assignments.unassigned
        if not some(rows):
            return plan
        own, planned = self._setpoint, plan.setpoint
        self._setpoint = self._no_setpoint
        setpoint = Setpoint(
            np.where(rows[:, None], own.velocity, planned.velocity),
            np.where(rows, own.yaw, planned.yaw),
            planned.active | rows,
        )
        both = replace(
            setpoint,
            position=merged(planned.position, own.position, rows),
            acceleration=merged(planned.acceleration, own.acceleration, rows),
            yaw_rate=merged(planned.yaw_rate, own.yaw_rate, rows),
        )
        setpoint = setpoint.following(both, both.followed())
        return replace(plan, setpoint=setpoint, unreachable=plan.unreachable & ~rows)

    def _take_over(self, rows: Rows) -> None:
        """Let agents leave the steps that they are in."""
        self._pending = True
        self._free.update(rows.tolist())
        if self._direct[rows].all():
            return
        self._direct[rows] = True
        slots = [self._assignments.slot(row) for row in rows.tolist()]
        self._number += 1
        self._assignments.take_over((slot for slot in slots if slot is not None), self._number)

    def _problems(self, plugin: Found, options: Mapping[str, Any]) -> Iterator[str]:
        """Yield what the schema of a verb refuses."""
        from jsonschema import Draft202012Validator  # some 50 ms

        properties = plugin.offer.options.get("properties", {})
        for name in options.keys() - properties.keys():
            hint = suggestion(name, properties, "there are")
            yield f"no option {name!r}{hint} [unknown-option]"
        for error in Draft202012Validator(plugin.offer.options).iter_errors(dict(options)):
            where = "".join(f"{key}: " for key in error.absolute_path)
            yield f"{where}{error.message} [invalid-option]"

    def _checked(
        self, plugin: Found, rows: tuple[int, ...], options: Mapping[str, Any]
    ) -> Iterator[str]:
        """Yield what the check of a verb finds, besides warnings."""
        check = plugin.offer.check
        if check is None:
            return
        for problem in guarded("task", plugin, partial(check, **options), self._scene, rows):
            if not problem.warning:
                where = "".join(f"{key}: " for key in problem.path)
                yield f"{where}{problem.message} [{problem.code}]"
