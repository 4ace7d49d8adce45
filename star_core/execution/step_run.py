"""One running step of a mission: its agents, its progress, and why it failed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, Final, Self

import numpy as np

from star_core.contracts import Status, Task, TaskOutput
from star_core.errors import ContractError
from star_core.execution.assignments import Assignments, Team
from star_core.execution.goal_buffer import GoalBuffer
from star_core.execution.task_pool import TaskPool
from star_core.messages.events import Event
from star_core.messages.state import AgentPhase, Estimate, Health
from star_core.messages.validation import require_type
from star_core.metrics.compute_time import ComputeTime
from star_core.mission_file.conditions import ConditionContext, holds, longest
from star_core.mission_file.step_tree import Action
from star_core.plugin_guard import PluginGuard
from star_core.scene import Scene
from star_core.toolkit.timeouts import step_timeout

THERE: Final = 0.05
"""How near to its goal an agent is there, in what is said of a time-out, m."""


@dataclass(slots=True)
class StepContext:
    """What all steps under way go by.

    Attributes:
        scene: What does not change.
        roster: The agents of the mission.
        tasks: What decides, made before take-off.
        wishes: Where all that is wanted in a tick goes.
        events: Everything that is told in the flight, the newest last.
        compute_time: Measures how long each task takes.
        targets: Names of the world's targets, in its order.
        time: Mission time, s.
        estimate: Where the agents are.
        health: How they are.
        out: Rows of those that cannot go on.
        refused: What agents will not do, by row.
        unreachable: Why there is no way to an agent's goal, by row.
    """

    scene: Scene
    roster: Assignments
    tasks: TaskPool
    wishes: GoalBuffer
    events: Sequence[Event]
    compute_time: ComputeTime
    targets: tuple[str, ...] = field(init=False)
    time: float = field(init=False, default=0.0)
    estimate: Estimate = field(init=False)
    health: Health = field(init=False)
    out: set[int] = field(init=False)
    refused: dict[int, str] = field(init=False)
    unreachable: dict[int, str] = field(init=False)

    def __post_init__(self) -> None:
        self.targets = tuple(dict.fromkeys(tag.of for tag in self.scene.world.targets))

    def update(
        self,
        time: float,
        estimate: Estimate,
        health: Health,
        *,
        out: set[int],
        refused: dict[int, str],
        unreachable: dict[int, str],
    ) -> None:
        """Begin a tick; the arguments are the attributes of the same names."""
        self.time, self.estimate, self.health = time, estimate, health
        self.out, self.refused, self.unreachable = out, refused, unreachable


@dataclass(slots=True)
class StepRun:
    """A step under way.

    Attributes:
        action: What is done.
        team: Its agents.
        seen: The version of the roster that `team` is of.
        task: What decides, as a plugin made it.
        blame: Whose fault it is if that raises.
        limit: How long it may take, s.
        begun: When it began, s.
        entry: What ``summary.json`` says of it.
        moment: What it goes by.
    """

    action: Action
    team: Team
    seen: int
    task: Task
    blame: PluginGuard
    limit: float
    begun: float
    entry: dict[str, Any]
    moment: StepContext

    @classmethod
    def begin(cls, action: Action, team: Team, moment: StepContext) -> Self:
        """Begin a step for a team."""
        seen = moment.roster.version
        task, blame = moment.tasks.take(action, team.rows)
        limit = _started(action, task, blame, moment)
        entry = {
            "place": action.place,
            "verb": action.verb,
            "agents": [moment.scene.agents[row].name for row in team.rows],
            "begun_s": moment.time,
            "ended_s": None,
            "outcome": None,
        }
        return cls(action, team, seen, task, blame, limit, moment.time, entry, moment)

    @property
    def rows(self) -> tuple[int, ...]:
        """Rows of the agents that do it."""
        return self.team.rows

    def step(self) -> tuple[Status, str]:
        """Run one tick of it; return how far it is, and why it failed."""
        now, wishes = self.moment, self.moment.wishes
        if self.seen != now.roster.version:
            self._hand_on()
        if not self.rows:
            return Status.FAILURE, "no agent is left for it"
        wishes.doing.append(f"{self.action.verb} {self.team.names}")
        if why := self._gone():
            return Status.FAILURE, why
        with now.compute_time.of(self.blame.whom), self.blame:
            step = require_type(self.task.step(now.estimate, now.health), TaskOutput)
            if not isinstance(step.status, Status):
                raise ContractError(f"Step.status is {step.status!r}, expected a Status")
            wishes.add(step, self.team.own)
        if step.status is Status.SUCCESS or self._fulfilled():
            return Status.SUCCESS, ""
        if step.status is Status.FAILURE:
            return Status.FAILURE, step.reason or "failed and gave no reason"
        if now.time - self.begun >= self.limit:
            return Status.FAILURE, f"timed out after {self.limit:.3g} s{self._behind()}"
        return Status.RUNNING, ""

    def _behind(self) -> str:
        """What keeps agents from being done, as far as the core can see."""
        now, wishes, said = self.moment, self.moment.wishes, []
        for row in self.rows:
            name, phase = now.scene.agents[row].name, AgentPhase(now.health.phase[row])
            away = wishes.position[row] - now.estimate.position[row]
            if not now.estimate.valid[row]:
                said.append(f"{name} is not located")
            elif phase is not AgentPhase.FLYING:
                said.append(f"{name} is {phase.name.lower().replace('_', ' ')}")
            elif wishes.active[row] and (far := float(np.linalg.norm(away))) > THERE:
                said.append(f"{name} is {far:.2f} m from its goal")
        return f": {', '.join(said)}" if said else ""

    def _hand_on(self) -> None:
        """Let it go on with those that hold its places now.

        A task that cannot be told is begun anew. An agent that fills an empty slot is in the
        next step only, if the task cannot be told of it.
        """
        roster, wishes = self.moment.roster, self.moment.wishes
        self.seen = roster.version
        before, now = self.team.holders, roster.holders(self.action.rows)
        if now == before:
            return
        wishes.free |= set(before.values()) - set(now.values())
        kept = {place: now[place] for place in before if place in now}
        swaps = [(before[place], row) for place, row in kept.items() if before[place] != row]
        self.team = Team.of(kept, self.moment.scene.names)
        methods: tuple[Any, ...] = tuple(
            getattr(self.task, f"on_{change}", None)
            for change in ("agent_replaced", "agents_removed", "agents_added")
        )
        replaced, removed, added = methods
        if not kept:
            return
        if (swaps and replaced is None) or (len(kept) < len(before) and removed is None):
            wishes.free.update(self.rows)
            task, _ = self.moment.tasks.take(self.action, self.rows)
            self.task, limit = task, _started(self.action, task, self.blame, self.moment)
            if self.action.timeout is None:
                self.limit = self.moment.time - self.begun + limit
            return
        with self.blame:
            for old, new in swaps:
                replaced(old, new)
            if len(kept) < len(before):
                removed(self.rows)
            if len(kept) < len(now) and added is not None:
                self.team = Team.of(now, self.moment.scene.names)
                added(self.rows)

    def _fulfilled(self) -> bool:
        """Whether the condition holds that ends it."""
        until, moment = self.action.until, self.moment
        if until is None:
            return False
        finder = moment.health.finder.tolist()
        found = [name for name, row in zip(moment.targets, finder, strict=True) if row >= 0]
        now = ConditionContext(
            rows=self.rows,
            begun=self.begun,
            time=moment.time,
            estimate=moment.estimate,
            health=moment.health,
            names=moment.scene.names,
            targets=found,
            events=moment.events,
        )
        return holds(until, now)

    def _gone(self) -> str:
        """Say which agents cannot go on, if any."""
        now = self.moment
        if not now.out and not now.unreachable and not now.refused:
            return ""
        phase, names = now.health.phase, now.scene.names
        said = [
            f"{names[row]} is {AgentPhase(int(phase[row])).name.lower()}"
            for row in self.rows
            if row in now.out
        ]
        said += [f"{names[row]} {now.refused[row]}" for row in self.rows if row in now.refused]
        said += [
            f"{names[row]} cannot get there: {now.unreachable[row]}"
            for row in self.rows
            if row in now.unreachable
        ]
        return ", ".join(said)


def _started(action: Action, task: Task, blame: PluginGuard, moment: StepContext) -> float:
    """Start a task; return the time-out of its step, s."""
    with moment.compute_time.of(blame.whom), blame:
        limit = task.begin(moment.estimate, moment.health)
        if not isinstance(limit, Real) or not 0 < limit < np.inf:
            raise ContractError(f"begin() returned {limit!r}, expected how long it takes, s")
    wait = None if action.until is None else longest(action.until)
    return step_timeout(float(limit), wait, action.timeout)
