"""One running step of a mission: its task, agents and progress, and the reason of its failure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from star_core.conditions import Condition, ConditionContext
from star_core.contracts import (
    AddsAgents,
    ContinuesFrom,
    RemovesAgents,
    ReplacesAgents,
    Status,
    Task,
    TaskOutput,
)
from star_core.errors import ContractError, shortlist
from star_core.execution.assignments import Assignments, Team
from star_core.execution.instructions import GoalCheck, Instructions
from star_core.messages.commands import Trajectory
from star_core.messages.state import AgentPhase, Estimate, Goals, Health
from star_core.mission import Action, Mission, actions
from star_core.observers import Observers
from star_core.plugin_support.compute_time import ComputeTime
from star_core.plugin_support.guard import (
    PluginGuard,
    Strikes,
    close_all,
    require_methods,
    require_signature,
)
from star_core.plugin_support.outputs import checked_timeout
from star_core.plugin_support.registry import Registry
from star_core.plugin_support.specs import TaskSpec
from star_core.toolkit.timeouts import step_timeout
from star_core.world.scene import Scene

Rows: TypeAlias = tuple[int, ...]
Rounds: TypeAlias = tuple[tuple[int, int], ...]
"""Round, from 1, and number of rounds of each ``repeat`` around a step, the outermost first."""
ARRIVED: Final = 0.05  # m; an agent farther from its goal is named when its step times out


@dataclass(frozen=True, slots=True)
class TickContext:
    """Inputs of all steps in one tick.

    Attributes:
        time: Mission time, s. Timeouts go by it: an estimate is only as new as the telemetry.
        estimate: Of the agents' positions.
        health: Phase, battery and link of each agent.
        disabled: The states of agents that cannot continue their steps, by row.
        refusals: Reasons why agents refused commands, by row.
        unreachable: Reasons why the planner could not reach goals in the last tick, by row.
        goals: Of the last tick.
    """

    time: float
    estimate: Estimate
    health: Health
    disabled: Mapping[int, str]
    refusals: Mapping[int, str]
    unreachable: Mapping[int, str]
    goals: Goals


@dataclass(frozen=True, slots=True)
class Execution:
    """State that all running steps share.

    Attributes:
        scene: Static description of the flight.
        assignments: The agents of the mission.
        tasks: Made before take-off.
        observers: Receive the messages of tasks; their events end steps.
        strikes: Counts the failures of tasks.
    """

    scene: Scene
    assignments: Assignments
    tasks: TaskPool
    observers: Observers
    strikes: Strikes

    def holds(self, condition: Condition, tick: TickContext, rows: Rows, begun: float) -> bool:
        """Return whether a condition of some agents holds, from a time on, s, if that matters."""
        scene = self.scene
        targets = tuple(dict.fromkeys(tag.of for tag in scene.world.targets))
        finders = zip(targets, tick.health.finder.tolist(), strict=True)
        now = ConditionContext(
            rows=rows,
            begun=begun,
            time=tick.time,
            estimate=tick.estimate,
            health=tick.health,
            names=scene.names,
            targets={name: scene.names[row] for name, row in finders if row >= 0},
            events=self.observers.events,
        )
        return condition.holds(now)

    def log(self, what: str, action: Action, rows: Rows, rounds: Rounds) -> None:
        """Report an event of a step: ``patrol.yaml:5 goto cf1 [2/3] done``."""
        self.report("step", f"{self.label(action, rows, rounds)} {what}", action, rows, rounds)

    def label(self, action: Action, rows: Rows, rounds: Rounds) -> str:
        """Return location, verb, agents and rounds of a step: ``patrol.yaml:5 goto cf1 [2/3]``."""
        agents = f" {self.scene.label(rows)}" if rows else ""
        return action.label + agents + "".join(f" [{i}/{times}]" for i, times in rounds)

    def report(self, kind: str, text: str, action: Action, rows: Rows, rounds: Rounds) -> None:
        """Report an event with the details of a step."""
        details = self.details(action, rows, rounds)
        agent = details["agents"][0] if len(rows) == 1 else None
        self.observers.event(kind, text, agent, details)

    def details(self, action: Action, rows: Rows, rounds: Rounds) -> dict[str, Any]:
        """Return what identifies a step in ``summary.json``."""
        return {
            "location": action.location,
            "included_from": list(action.included_from),
            "verb": action.verb,
            "agents": [self.scene.agents[row].name for row in rows],
            "rounds": [list(assigned) for assigned in rounds],
        }


class StepRun:
    """A running step, which begins when it is made.

    Args:
        shared: With the other steps.

    Attributes:
        action: The step.
        rounds: Of the ``repeat`` around it.
        team: Its agents.
        timeout: Of the step, s.
        entry: Of ``steps`` in ``summary.json``.
    """

    def __init__(
        self,
        action: Action,
        team: Team,
        tick: TickContext,
        instructions: Instructions,
        shared: Execution,
        rounds: Rounds,
    ) -> None:
        self.action, self.rounds, self.team = action, rounds, team
        self._shared = shared
        self._version = shared.assignments.version  # that `team` is of
        self._task, self._guard = shared.tasks.take(action, team.rows)
        self._begun = tick.time
        self.timeout = self._begin_task(tick, instructions)
        self._goal_check = GoalCheck()
        self.entry: dict[str, Any] = {
            **shared.details(action, team.rows, rounds),
            "begun_s": tick.time,
            "ended_s": None,
            "outcome": None,
        }

    def step(self, tick: TickContext, instructions: Instructions) -> tuple[Status, str]:
        """Run one tick of the step; return its status, and the reason of its failure."""
        if self._version != self._shared.assignments.version:
            self._update_team(tick, instructions)
        if not self.team.rows:
            return Status.FAILURE, "no agent is left for it"
        instructions.doing.append(f"{self.action.verb} {self.team.label}")
        if reason := self._disabled(tick):
            return Status.FAILURE, reason
        output = self._guard.attempt(
            self._shared.strikes,
            lambda: instructions.add(
                self._task.step(tick.estimate, tick.health),
                self.team.members,
                self._shared.tasks.trajectories,
                self._goal_check,
            ),
            TaskOutput,
        )
        for message in output.messages:
            text = f"{self.action.verb}: {message}"
            self._shared.report("task", text, self.action, self.team.rows, self.rounds)
        if output.status is Status.SUCCESS or self._is_until_met(tick):
            return Status.SUCCESS, ""
        if output.status is Status.FAILURE:
            return Status.FAILURE, output.reason or "failed and gave no reason"
        if tick.time - self._begun >= self.timeout:
            return (
                Status.FAILURE,
                f"timed out after {self.timeout:.3g} s{self._late(tick, instructions)}",
            )
        return Status.RUNNING, ""

    def _disabled(self, tick: TickContext) -> str:
        """Return which agents cannot continue and why, if any."""
        if not (tick.disabled or tick.refusals or tick.unreachable):
            return ""
        names = self._shared.scene.names
        reasons = [
            f"{names[row]} is {tick.disabled[row]}"
            for row in self.team.rows
            if row in tick.disabled
        ]
        if tick.time > self._begun:  # otherwise they are about the previous step
            for text, by_row in (("", tick.refusals), ("cannot get there: ", tick.unreachable)):
                rows = (row for row in self.team.rows if row in by_row)
                reasons += [f"{names[row]} {text}{by_row[row]}" for row in rows]
        return self._listed(reasons)

    def _late(self, tick: TickContext, instructions: Instructions) -> str:
        """Return why agents have not finished, as far as the core can see."""
        reasons, goals = [], instructions.goals
        for row in self.team.rows:
            name = self._shared.scene.agents[row].name
            phase = AgentPhase(tick.health.phase[row])
            away = float(np.linalg.norm(goals.position[row] - tick.estimate.position[row]))
            if not tick.estimate.valid[row]:
                reasons.append(f"{name} is not located")
            elif phase is not AgentPhase.FLYING:
                reasons.append(f"{name} is {phase.name.lower().replace('_', ' ')}")
            elif goals.active[row] and away > ARRIVED:
                reasons.append(f"{name} is {away:.2f} m from its goal")
        return f": {self._listed(reasons)}" if reasons else ""

    def _listed(self, causes: Sequence[str]) -> str:
        """Return the first causes of a failure, after adding all of them to the record."""
        if causes:
            self.entry["causes"] = list(causes)
        return shortlist(causes)

    def _update_team(self, tick: TickContext, instructions: Instructions) -> None:
        """Continue with the agents that are assigned to the step's slots now.

        A task without a method for the change is made again. An agent that fills an empty slot
        waits for the next step if the task has no `on_agents_added`.
        """
        assignments = self._shared.assignments
        self._version = assignments.version
        program = self._shared.tasks.program(self.action)
        before, now = self.team.holders, assignments.holders(self.action.rows, program)
        if now == before:
            return
        instructions.free |= set(before.values()) - set(now.values())
        kept = {slot: now[slot] for slot in before if slot in now}
        swaps = [(before[slot], row) for slot, row in kept.items() if before[slot] != row]
        self.team = Team.of(kept, self._shared.scene)
        if not kept:
            return
        task, fewer = self._task, len(kept) < len(before)
        if (swaps and not isinstance(task, ReplacesAgents)) or (
            fewer and not isinstance(task, RemovesAgents)
        ):
            instructions.free.update(self.team.rows)
            self._task, _ = self._shared.tasks.take(self.action, self.team.rows)
            limit = self._begin_task(tick, instructions)
            if self.action.timeout is None:
                self.timeout = tick.time - self._begun + limit
            return
        with self._guard:
            if isinstance(task, ReplacesAgents):
                for old, new in swaps:
                    task.on_agent_replaced(old, new)
            if fewer and isinstance(task, RemovesAgents):
                task.on_agents_removed(self.team.rows)
            if len(kept) < len(now) and isinstance(task, AddsAgents):
                self.team = Team.of(now, self._shared.scene)
                task.on_agents_added(self.team.rows)

    def _is_until_met(self, tick: TickContext) -> bool:
        """Return whether the step's ``until`` holds."""
        until = self.action.until
        return until is not None and self._shared.holds(until, tick, self.team.rows, self._begun)

    def _begin_task(self, tick: TickContext, instructions: Instructions) -> float:
        """Begin the task; return the timeout of the step, s."""
        task, action = self._task, self.action
        with self._guard:
            if isinstance(task, ContinuesFrom):
                task.continue_from(instructions.goals.goals())
            limit = checked_timeout(task.begin(tick.estimate, tick.health))
        wait = None if action.until is None else action.until.longest_wait
        return step_timeout(limit, wait, action.timeout)


class TaskPool:
    """Makes the task of every step at the start, and further ones as they are needed.

    Attributes:
        trajectories: Those that the tasks may order to be flown on board, each once.
    """

    def __init__(self, mission: Mission, registry: Registry, compute_time: ComputeTime) -> None:
        self._scene = mission.scene
        self._registry = registry
        self._compute_time = compute_time
        self._ready: dict[int, Task] = {}
        self._programs = {
            id(action): number
            for number, reaction in enumerate(mission.reactions, start=1)
            for action in actions(reaction.steps)
        }
        self._closing: list[tuple[PluginGuard, object]] = []
        self.trajectories: tuple[Trajectory, ...] = ()
        try:
            for action in actions(mission.all_steps):
                task = self._ready[id(action)] = self.make(action, action.rows)
                self._add_trajectories(task, self._guard(action))
        except BaseException:
            self.close()
            raise

    def add(self, action: Action, program: int) -> None:
        """Make the task of a further step, of a program with a number."""
        self._ready[id(action)] = self.make(action, action.rows)
        self._programs[id(action)] = program

    def take(self, action: Action, rows: tuple[int, ...]) -> tuple[Task, PluginGuard]:
        """Return a task of a step for some of its agents, and the guard that names its plugin."""
        ready = self._ready.pop(id(action), None) if rows == action.rows else None
        return ready or self.make(action, rows), self._guard(action, timed=True)

    def program(self, action: Action) -> int:
        """Return the program of a step: 0, or a number as of `Assignments.holders`."""
        return self._programs.get(id(action), 0)

    def spec(self, action: Action) -> TaskSpec:
        """Return the announcement of a step's task."""
        spec: TaskSpec = self._registry.find("task", action.verb).offer
        return spec

    def close(self) -> list[str]:
        """Close every task that has ``close()``; return their errors."""
        return close_all(self._closing)

    def _add_trajectories(self, task: Task, guard: PluginGuard) -> None:
        with guard:
            for trajectory in getattr(task, "trajectories", ()):
                if not isinstance(trajectory, Trajectory):
                    raise ContractError(
                        f"trajectories has {type(trajectory).__name__}, expected Trajectory"
                    )
                if trajectory not in self.trajectories:
                    self.trajectories += (trajectory,)

    def make(self, action: Action, rows: tuple[int, ...]) -> Task:
        """Make a step's task for some of its agents."""
        spec = self.spec(action)
        options = dict(action.options)
        guard = self._guard(action)
        with guard:
            require_signature(spec.make, "make", ("scene", "rows"), options)
            task: Task = spec.make(self._scene, rows, **options)
            if hasattr(task, "close"):
                self._closing.append((guard, task))
            require_methods(task, Task)
        return task

    def _guard(self, action: Action, *, timed: bool = False) -> PluginGuard:
        source = self._registry.find("task", action.verb).source
        plugin = f"task {action.verb!r} ({source})"
        stopwatch = self._compute_time.of(plugin) if timed else None
        return PluginGuard(plugin, stopwatch)
