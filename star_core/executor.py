"""Runs the steps of a mission: in order, at once, again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from star_core.contracts import Status
from star_core.execution.assignments import Assignments, Team
from star_core.execution.goal_buffer import GoalBuffer
from star_core.execution.step_run import StepContext, StepRun
from star_core.execution.task_pool import TaskPool
from star_core.messages.arrays import Mask
from star_core.messages.commands import Trajectory
from star_core.messages.state import AgentPhase, Estimate, Health, among
from star_core.metrics.compute_time import ComputeTime
from star_core.mission import Mission
from star_core.mission_file.step_tree import Action, Node, Parallel, Repeat
from star_core.observers import Observers
from star_core.plugin_schema import JOIN, LEAVE
from star_core.registry import Registry

OUT: Final = (AgentPhase.LOST, AgentPhase.EMERGENCY)
"""Phases in which an agent cannot go on with a step."""


@dataclass(frozen=True, slots=True)
class TickContext:
    """What the steps of a mission know in one tick.

    Attributes:
        time: Mission time, s. Timeouts go by it: an estimate is only as new as what was heard.
        estimate: Where the agents are.
        health: Phase, battery and link of each agent.
        excused: (N,) agents that may be lost without failing their step.
        refused: Commands that agents refused, and why, by row.
        unreachable: Why the planner found no way to a goal in the last tick, by row.
    """

    time: float
    estimate: Estimate
    health: Health
    excused: Mask
    refused: Mapping[int, str]
    unreachable: Mapping[int, str]


class StepExecutor:
    """Runs the steps of a mission.

    Args:
        mission: What to fly.
        registry: Where its verbs are found.
        assignments: The agents of the mission; an agent that loses its slot leaves its steps.
        observers: Receive the begin and the end of each step; their events end steps.
        compute_time: Measures how long each task takes.

    Attributes:
        reason: Why the mission failed, once it has.
        steps: What was begun and how it ended, as ``summary.json`` keeps it.
    """

    def __init__(
        self,
        mission: Mission,
        registry: Registry,
        assignments: Assignments,
        observers: Observers,
        compute_time: ComputeTime,
    ) -> None:
        self._n = len(mission.scene.agents)
        self._assignments = assignments
        self._report = observers.event
        self._goals = GoalBuffer.none(self._n, mission.scene.limits.speed)
        self.steps: list[dict[str, Any]] = []
        self._tasks = TaskPool(mission, registry)
        self._goals.uploaded = self._tasks.trajectories
        self._context = StepContext(
            mission.scene, assignments, self._tasks, self._goals, observers.events, compute_time
        )
        self._running = self._sequence(mission.steps)
        self.reason = ""

    @property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """What its tasks may order to be flown on board, each once."""
        return self._tasks.trajectories

    def step(self, tick: TickContext) -> tuple[Status, GoalBuffer]:
        """Run one tick of every step under way; return how far the mission is, and all goals."""
        out = np.flatnonzero(among(tick.health.phase, *OUT) & ~tick.excused)
        self._context.update(
            tick.time,
            tick.estimate,
            tick.health,
            out=set(out.tolist()),
            refused=dict(tick.refused),
            unreachable=dict(tick.unreachable),
        )
        self._goals.fresh()
        status = next(self._running)
        return status, self._goals

    def drop(self, row: int, estimate: Estimate) -> None:
        """Take an agent out of every step; its goal is its position."""
        self._assignments.vacate([row])
        self._goals.active[row] = False
        alone = np.zeros(self._n, np.bool_)
        alone[row] = True
        self._goals.hold(alone & estimate.valid, estimate)

    def close(self) -> list[str]:
        """Close every task that can be closed; return what went wrong.

        Steps that are under way have been aborted.
        """
        for entry in self.steps:
            if entry["outcome"] is None:
                entry |= {"ended_s": self._context.time, "outcome": "aborted"}
        return self._tasks.close()

    # Each of these yields a status a tick; the last is not RUNNING.

    def _node(self, node: Node) -> Iterator[Status]:
        match node:
            case Action():
                return self._action(node)
            case Parallel(branches):
                return self._parallel(branches)
            case Repeat(times, steps):
                return self._sequence(steps, times)

    def _sequence(self, steps: Sequence[Node], times: int = 1) -> Iterator[Status]:
        for again in range(times):
            if again:
                yield Status.RUNNING  # each round takes a tick at least
            for step in steps:
                for status in self._node(step):
                    if status is Status.FAILURE:
                        yield status
                        return
                    if status is Status.RUNNING:
                        yield status
        yield Status.SUCCESS

    def _parallel(self, branches: Sequence[Node]) -> Iterator[Status]:
        running = [self._node(branch) for branch in branches]
        while running:
            statuses = [(branch, next(branch)) for branch in running]
            if any(status is Status.FAILURE for _, status in statuses):
                yield Status.FAILURE
                return
            running = [branch for branch, status in statuses if status is Status.RUNNING]
            if running:
                yield Status.RUNNING
        yield Status.SUCCESS

    def _action(self, action: Action) -> Iterator[Status]:
        if action.verb == JOIN:
            self._muster(action)
        team = self._team(action.rows)
        if not team.rows:
            self._report(
                "step", f"{action.place}: {action.verb} is skipped: no agent is left for it"
            )
            yield Status.SUCCESS
            return
        run = self._begin(action, team)
        while (answer := run.step())[0] is Status.RUNNING:
            yield Status.RUNNING
        status, why = answer
        self._goals.free.update(run.rows)
        outcome = "success" if status is Status.SUCCESS else "failure"
        run.entry |= {"ended_s": self._context.time, "outcome": outcome}
        if status is Status.FAILURE and run.rows:
            yield self._failed(action, run.rows, why)
            return
        if status is Status.FAILURE:  # its agents left the mission, and the others need not know
            self._report("failure", f"{action.place}: {action.verb} failed: {why}")
            yield Status.SUCCESS
            return
        self._report("step", f"{action.place}: {action.verb} is done")
        if action.verb == LEAVE:
            self._assignments.vacate(run.rows, retire=True)
        yield Status.SUCCESS

    def _muster(self, action: Action) -> None:
        """Let agents that are in reserve be in the mission."""
        for place in action.rows:
            if place in self._assignments.retired:
                self._assignments.take(place, place)

    def _begin(self, action: Action, team: Team) -> StepRun:
        """Begin a step for those that hold its places."""
        self._report("step", f"{action.place}: {action.verb} begins for {team.names}")
        run = StepRun.begin(action, team, self._context)
        for row in team.rows:
            for reasons in (self._context.unreachable, self._context.refused):
                reasons.pop(row, None)  # of the step before
        self.steps.append(run.entry)
        return run

    def _team(self, places: tuple[int, ...]) -> Team:
        return Team.of(self._assignments.holders(places), self._context.scene.names)

    def _failed(self, action: Action, rows: tuple[int, ...], why: str) -> Status:
        """Do what the mission says about a step that failed."""
        text = f"{action.place}: {action.verb} failed: {why}"
        if action.on_failure == "abort":
            self.reason = text
            return Status.FAILURE
        lost = {row for row in rows if self._context.health.phase[row] in OUT}
        leave = set(rows) if action.on_failure == "land" else lost
        self._assignments.vacate(leave, retire=action.on_failure == "land")
        self._goals.leave |= leave
        self._report("failure", f"{text}; on_failure: {action.on_failure}")
        return Status.SUCCESS
