"""Runs the steps of a mission: sequences, ``parallel``, ``each``, ``repeat``, ``if``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from star_core.contracts import Status
from star_core.execution.assignments import Assignments, Team
from star_core.execution.instructions import GoalDraft, Instructions
from star_core.execution.step_run import (
    Execution,
    Rounds,
    StepRun,
    TaskPool,
    TickContext,
)
from star_core.messages.state import UNFIT, AgentPhase
from star_core.mission import Action, Choice, Mission, Node, Parallel, Reaction, Repeat
from star_core.observers import Observers
from star_core.plugin_support.guard import Strikes
from star_core.plugin_support.option_schema import JOIN, LEAVE


@dataclass(slots=True)
class StartedStep:
    """A step that a program started.

    Attributes:
        action: The step.
        over: Whether it has ended.
        entry: Of ``steps`` in ``summary.json``, once it has begun.
    """

    action: Action
    over: bool = False
    entry: Mapping[str, Any] = field(default_factory=dict)

    @property
    def outcome(self) -> str | None:
        """``success``, ``failure``, or ``aborted`` if its agents left it; None while it runs."""
        outcome: str | None = self.entry.get("outcome")
        return outcome or ("aborted" if self.over else None)


class StepExecutor:
    """Runs the steps of a mission.

    Args:
        assignments: The agents of the mission; an agent that loses its slot leaves its steps.
        observers: Receive the begin and the end of each step; their events end steps.

    Attributes:
        reason: Why the mission failed, once it has.
        steps: Steps begun so far, as in ``summary.json``.
    """

    def __init__(
        self,
        mission: Mission,
        tasks: TaskPool,
        assignments: Assignments,
        observers: Observers,
        strikes: Strikes,
    ) -> None:
        self._assignments = assignments
        self._tasks = tasks
        self._shared = Execution(mission.scene, assignments, tasks, observers, strikes)
        self._tick: TickContext
        self._instructions: Instructions
        self._running = [self._sequence(mission.steps)]
        self._reactions = dict(enumerate(mission.reactions, start=1))  # that have not begun
        self._ending: set[int] = set()  # agents in steps that end on the ground
        self._time = 0.0
        self.steps: list[dict[str, Any]] = []
        self.reason = ""

    def step(self, tick: TickContext) -> tuple[Status, Instructions]:
        """Run one tick of every running step; return the mission's status, and what to do."""
        self._tick, self._time = tick, tick.time
        self._instructions = Instructions(GoalDraft(tick.goals))
        self._instructions.goals.stop()
        if self._reactions:
            self._react()
        statuses = [next(sequence) for sequence in self._running]
        pairs = zip(self._running, statuses, strict=True)
        self._running = [sequence for sequence, status in pairs if status is Status.RUNNING]
        status = Status.RUNNING if self._running else Status.SUCCESS
        if Status.FAILURE in statuses:
            status = Status.FAILURE
        return status, self._instructions

    def start(self, action: Action, program: int) -> StartedStep:
        """Start a step in the next tick, whose agents leave the steps that they are in.

        Args:
            action: The step.
            program: Its number, above those of all programs so far.

        Raises:
            PluginError: Its task cannot be made.
        """
        self._tasks.add(action, program)
        self._assignments.take_over(action.rows, program)
        step = StartedStep(action)
        self._running.append(self._started(step))
        return step

    def _started(self, step: StartedStep) -> Iterator[Status]:
        begun = len(self.steps)
        for status in self._sequence([step.action]):
            if not step.entry and len(self.steps) > begun:
                step.entry = self.steps[begun]
            step.over = status is not Status.RUNNING
            yield status

    def _react(self) -> None:
        """Begin the reactions whose conditions hold, once none of their agents takes off.

        They take over no agent from a reaction before them in the mission, none whose step ends on
        the ground or that lands, and none that is on the ground or in the air where their steps
        need it to be elsewhere.
        """
        assignments, tick = self._assignments, self._tick
        phase = tick.health.phase
        for number, reaction in list(self._reactions.items()):
            rows = tuple(assignments.holders(range(len(phase))).values())
            if not reaction.first and not self._shared.holds(reaction.when, tick, rows, begun=0.0):
                continue
            free: dict[int, int] = {}
            for slot, first in reaction.first_actions.items():
                joins = first.verb == JOIN and slot in assignments.retired
                row = slot if joins else assignments.holders([slot]).get(slot)
                before = self._tasks.spec(first).before
                if row is None or row in self._ending or phase[row] in {AgentPhase.LANDING, *UNFIT}:
                    continue
                flies = phase[row] in {AgentPhase.FLYING, AgentPhase.TAKING_OFF}
                fits = before is None or flies == (before == "air")
                if fits and (assignments.program(slot) or number) >= number:
                    free[slot] = row
            if reaction.first:
                free = self._first(reaction, free)
                if not free:
                    continue
            if any(phase[row] == AgentPhase.TAKING_OFF for row in free.values()):
                continue
            del self._reactions[number]
            named = self._shared.scene.named(free.values()) or "no agent"
            text = f"{reaction.label}: {named} {'react' if len(free) > 1 else 'reacts'}"
            self._shared.observers.event("step", text, details={"location": reaction.location})
            if free:
                assignments.take_over(free, number)
                self._running.append(self._sequence(reaction.steps_of(free)))

    def _first(self, reaction: Reaction, free: Mapping[int, int]) -> dict[int, int]:
        """Return the first of some slots for whose agent the condition of a reaction holds."""
        for slot, row in free.items():
            if self._shared.holds(reaction.when, self._tick, (row,), begun=0.0):
                return {slot: row}
        return {}

    def close(self) -> list[str]:
        """Abort the running steps and close every task; return their errors."""
        for entry in self.steps:
            if entry["outcome"] is None:
                entry |= {"ended_s": self._time, "outcome": "aborted"}
        return self._tasks.close()

    # Each of these yields a status per tick; the last is not RUNNING.

    def _node(self, node: Node, rounds: Rounds) -> Iterator[Status]:
        match node:
            case Action():
                return self._action(node, rounds)
            case Parallel(branches):
                return self._parallel(branches, rounds)
            case Repeat(times, steps):
                return self._sequence(steps, rounds, times)
            case Choice():
                return self._choice(node, rounds)

    def _sequence(
        self, steps: Sequence[Node], rounds: Rounds = (), times: int = 1
    ) -> Iterator[Status]:
        for again in range(times):
            if again:
                yield Status.RUNNING  # each round takes a tick at least
            now = (*rounds, (again + 1, times)) if times > 1 else rounds
            for step in steps:
                for status in self._node(step, now):
                    if status is Status.FAILURE:
                        yield status
                        return
                    if status is Status.RUNNING:
                        yield status
        yield Status.SUCCESS

    def _parallel(self, branches: Sequence[Node], rounds: Rounds) -> Iterator[Status]:
        running = [self._node(branch, rounds) for branch in branches]
        while running:
            statuses = [(branch, next(branch)) for branch in running]
            if any(status is Status.FAILURE for _, status in statuses):
                yield Status.FAILURE
                return
            running = [branch for branch, status in statuses if status is Status.RUNNING]
            if running:
                yield Status.RUNNING
        yield Status.SUCCESS

    def _choice(self, choice: Choice, rounds: Rounds) -> Iterator[Status]:
        rows = tuple(self._assignments.holders(choice.rows).values())
        holds = self._shared.holds(choice.when, self._tick, rows, begun=0.0)
        text = f"{choice.label}: {'yes' if holds else 'no'}"
        self._shared.observers.event("step", text, details={"location": choice.location})
        yield from self._sequence(choice.steps if holds else choice.otherwise, rounds)

    def _action(self, action: Action, rounds: Rounds) -> Iterator[Status]:
        if action.verb == JOIN:
            for slot in self._assignments.retired.intersection(action.rows):
                self._assignments.assign(slot, slot)
        log, scene = self._shared.log, self._shared.scene
        program = self._tasks.program(action)
        holders = self._assignments.holders(action.rows, program)
        if not holders:
            log("skipped: no agent is left for it", action, (), rounds)
            yield Status.SUCCESS
            return
        team = Team.of(holders, scene)
        until = "" if action.until is None else f", until {action.until}"
        unlocated = [row for row in team.rows if not self._tick.estimate.valid[row]]
        wait = f", not located yet: {scene.named(unlocated)}" if unlocated else ""
        log(f"begins{until}{wait}", action, team.rows, rounds)
        run = StepRun(action, team, self._tick, self._instructions, self._shared, rounds)
        self.steps.append(run.entry)
        ends = self._tasks.spec(action).after == "ground"
        while (result := run.step(self._tick, self._instructions))[0] is Status.RUNNING:
            if ends:
                self._ending.update(run.team.rows)
            yield Status.RUNNING
        status, reason = result
        self._ending.difference_update(run.team.rows if ends else ())
        if not run.team.rows and self._assignments.holders(action.rows):
            run.entry |= {"ended_s": self._tick.time, "outcome": "aborted"}
            log("is over: its agents react", action, (), rounds)
            yield Status.SUCCESS
            return
        self._instructions.free.update(run.team.rows)
        outcome = "success" if status is Status.SUCCESS else "failure"
        run.entry |= {"ended_s": self._tick.time, "outcome": outcome}
        if status is Status.FAILURE:
            yield self._fail(run, reason)
            return
        log("done", action, run.team.rows, rounds)
        if action.verb == LEAVE:
            self._assignments.vacate(run.team.rows, retire=True)
        yield Status.SUCCESS

    def _fail(self, run: StepRun, reason: str) -> Status:
        """Apply ``on_failure`` to a step that failed; return the status for the steps above it.

        A step without agents does not fail the mission: they have been removed from it.
        """
        action, rows, rounds = run.action, run.team.rows, run.rounds
        text = f"{self._shared.label(action, rows, rounds)} failed: {reason}"
        if not rows:
            self._shared.report("failure", text, action, rows, rounds)
            return Status.SUCCESS
        if action.on_failure == "abort":
            self.reason = text
            return Status.FAILURE
        land = action.on_failure == "land"
        phase = self._tick.health.phase
        leave = set(rows) if land else {row for row in rows if phase[row] in UNFIT}
        self._assignments.vacate(leave, retire=land)
        self._instructions.leave |= leave
        text += f"; on_failure: {action.on_failure}"
        self._shared.report("failure", text, action, rows, rounds)
        return Status.SUCCESS
