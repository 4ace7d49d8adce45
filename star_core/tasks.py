"""Runs the steps of a mission: in order, at once, again; and merges what they want."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias, cast

import numpy as np

from star_core.blame import Blame, close
from star_core.conditions import Situation, holds, longest
from star_core.conformance import expect, keeps
from star_core.contracts import Status, Step, Task
from star_core.errors import ContractError
from star_core.flight import Event
from star_core.mission import Action, Mission, Node, Parallel, Repeat
from star_core.registry import Registry
from star_core.swarm import AgentPhase, Command, Estimate, Goals, Health, Order
from star_core.table import Mask

OUT: Final = (int(AgentPhase.LOST), int(AgentPhase.EMERGENCY))
"""Phases in which an agent cannot go on with a step."""

PATIENCE: Final = 5.0
"""How much longer a step may take than its condition waits for, s."""

NUMBERED: Final = (Order.TAKEOFF, Order.LAND, Order.GOTO)
"""Orders that say where and how fast."""

Tell: TypeAlias = Callable[[str, str], None]


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

    def add(self, step: Step, rows: tuple[int, ...], n: int) -> None:
        """Merge a task's answer, which may speak for its own rows only.

        Raises:
            ContractError: It speaks for others, has another number of rows, or is not finite.
        """
        own = np.zeros(n, np.bool_)
        own[list(rows)] = True
        for command in step.commands:
            agents = expect(command, Command).agent
            if not (set(agents.tolist()) <= set(rows)):
                raise ContractError(f"commands agents {agents.tolist()!r}, its own are {rows!r}")
            for name in ("position", "yaw", "duration") if command.order in NUMBERED else ():
                values = getattr(command, name)
                if not np.isfinite(values).all():
                    raise ContractError(f"Command.{name} is {values.tolist()!r}, expected numbers")
            self.commands.append(command)
        if step.goals is None:
            return
        goals = expect(step.goals, Goals)
        if len(goals.active) != n:
            raise ContractError(f"Goals.position has {len(goals.active)} rows, expected {n}")
        if (goals.active > own).any():
            raise ContractError("has goals for agents that are not its own")
        about = np.flatnonzero(goals.active)
        for name in ("position", "velocity", "yaw", "speed"):
            values = getattr(goals, name)[about]
            if not np.isfinite(values).all():
                raise ContractError(f"Goals.{name} is {values.tolist()!r}, expected numbers")
            getattr(self, name)[about] = values
        self.active[about] = True

    def goals(self) -> Goals:
        """The merged goals as a table."""
        return Goals(self.position, self.velocity, self.yaw, self.speed, self.active)


class Course:
    """The steps of a mission as they are flown.

    Args:
        mission: What to fly.
        registry: Where its verbs are found.
        tell: Told of each step's begin and end: kind and text.
        events: Everything that is told in the flight, the newest last.

    Attributes:
        left: Agents that left the mission, as a step that failed allowed them to, or a safety
            rule said.
        excused: (N,) who may be lost without failing its step; to be set before each tick.
        reason: Why the mission failed, once it has.
        no_way: Why there is no way to an agent's goal, by row; to be set after each tick.
        steps: What was begun and how it ended, as ``summary.json`` keeps it.
    """

    def __init__(
        self, mission: Mission, registry: Registry, tell: Tell, events: Sequence[Event]
    ) -> None:
        self._scene = mission.scene
        self._n = len(self._scene.agents)
        self._registry = registry
        self._tell = tell
        self._events = events
        self._targets = tuple(dict.fromkeys(tag.of for tag in self._scene.world.targets))
        self._wishes = Wishes.none(self._n)
        self._made: dict[int, Task] = {}
        self._all: list[tuple[Blame, object]] = []
        try:
            self._prepare(mission.steps)
        except BaseException:
            self.close()
            raise
        self._running = self._sequence(mission.steps)
        self._estimate: Estimate
        self._health: Health
        self.left: set[int] = set()
        self.excused: Mask = np.zeros(self._n, np.bool_)
        self.reason = ""
        self.no_way: dict[int, str] = {}
        self.steps: list[dict[str, Any]] = []

    def step(self, estimate: Estimate, health: Health) -> tuple[Status, Wishes]:
        """Run one tick of every step under way; all that is wanted is in the answer."""
        self._estimate, self._health = estimate, health
        self._wishes.fresh()
        status = next(self._running)
        return status, self._wishes

    def hold(self, flying: Mask, estimate: Estimate) -> None:
        """Give agents that fly without a goal the place where they are as their goal."""
        rows = flying & ~self._wishes.active
        if not rows.any():
            return
        self._wishes.position[rows] = estimate.position[rows]
        self._wishes.yaw[rows] = estimate.yaw[rows]
        self._wishes.speed[rows] = self._scene.limits.speed
        self._wishes.active[rows] = True

    def drop(self, row: int, estimate: Estimate) -> None:
        """Take an agent out of every step; its goal is the place where it is."""
        self.left.add(row)
        self._wishes.active[row] = False
        alone = np.zeros(self._n, np.bool_)
        alone[row] = True
        self.hold(alone & estimate.valid, estimate)

    def close(self) -> list[str]:
        """Close every task that can be closed; return what went wrong."""
        return close(self._all)

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
        rows = tuple(row for row in action.rows if row not in self.left)
        if not rows:
            self._tell("step", f"{action.place}: {action.verb} is left out: nobody is left for it")
            yield Status.SUCCESS
            return
        who = self._scene.named(rows)
        self._tell("step", f"{action.place}: {action.verb} begins for {who}")
        blame, task, limit = self._begin(action, rows)
        for row in rows:
            self.no_way.pop(row, None)  # that was said of the step before
        begun = self._estimate.time
        entry = self._entered(action, rows)
        while True:
            if self.left.intersection(rows):
                rows = tuple(row for row in rows if row not in self.left)
                if not rows:
                    why = "nobody is left for it"
                    break
                task = self._hand_on(action, blame, task, rows)
                who = self._scene.named(rows)
            self._wishes.doing.append(f"{action.verb} {who}")
            if why := self._gone(rows):
                break
            with blame:
                step = expect(task.step(self._estimate, self._health), Step)
                self._wishes.add(step, rows, self._n)
            if step.status is Status.SUCCESS or self._fulfilled(action, rows, begun):
                self._tell("step", f"{action.place}: {action.verb} is done")
                entry |= {"ended_s": self._estimate.time, "outcome": "success"}
                yield Status.SUCCESS
                return
            if step.status is Status.FAILURE:
                why = step.reason or "failed and gave no reason"
                break
            if self._estimate.time - begun >= limit:
                why = f"timed out after {limit:.3g} s"
                break
            yield Status.RUNNING
        entry |= {"ended_s": self._estimate.time, "outcome": "failure"}
        yield self._failed(action, rows, why)

    def _prepare(self, nodes: Sequence[Node]) -> None:
        """Make every step's task once before anything moves: what is slow or wrong shows now."""
        for node in nodes:
            match node:
                case Action():
                    self._made[id(node)] = self._task(node, node.rows)
                case Parallel(inner) | Repeat(_, inner):
                    self._prepare(inner)

    def _task(self, action: Action, rows: tuple[int, ...]) -> Task:
        """Make a step's task for some of its agents."""
        offer = self._registry.find("task", action.verb).offer
        with self._blame(action):
            task = offer.make(self._scene, rows, **action.options)
            self._all.append((self._blame(action), task))
            keeps(task, Task)
        return cast("Task", task)

    def _blame(self, action: Action) -> Blame:
        source = self._registry.find("task", action.verb).source
        return Blame(f"task {action.verb!r} ({source})")

    def _begin(self, action: Action, rows: tuple[int, ...]) -> tuple[Blame, Task, float]:
        """Begin a step's task; return it with its time-out, s."""
        blame = self._blame(action)
        task = self._made.pop(id(action), None) if rows == action.rows else None
        task = task or self._task(action, rows)
        with blame:
            limit = float(task.begin(self._estimate, self._health))
            if not limit < np.inf:
                raise ContractError(f"begin() returned {limit!r}, expected how long it takes, s")
        if action.until is not None:
            limit = max(limit, longest(action.until) + PATIENCE)
        return blame, task, limit if action.timeout is None else action.timeout

    def _hand_on(self, action: Action, blame: Blame, task: Task, rows: tuple[int, ...]) -> Task:
        """Leave a step to those of its agents that are left; return the task that goes on with it.

        A task that cannot be told is begun anew for the others.
        """
        stay = getattr(task, "stay", None)
        if stay is not None:
            with blame:
                stay(rows)
            return task
        return self._begin(action, rows)[1]

    def _fulfilled(self, action: Action, rows: tuple[int, ...], begun: float) -> bool:
        """Whether the condition holds that ends a step."""
        if action.until is None:
            return False
        finder = self._health.finder.tolist()
        found = [name for name, row in zip(self._targets, finder, strict=True) if row >= 0]
        return holds(
            action.until,
            Situation(
                rows, begun, self._estimate, self._health, self._scene.names, found, self._events
            ),
        )

    def _entered(self, action: Action, rows: tuple[int, ...]) -> dict[str, Any]:
        """Enter a step that begins in `steps`."""
        entry = {
            "place": action.place,
            "verb": action.verb,
            "agents": [self._scene.agents[row].name for row in rows],
            "begun_s": self._estimate.time,
            "ended_s": None,
            "outcome": None,
        }
        self.steps.append(entry)
        return entry

    def _gone(self, rows: tuple[int, ...]) -> str:
        """Say which agents of a step cannot go on, if any."""
        phases = self._health.phase.tolist()
        said = [
            f"{self._scene.agents[row].name} is {AgentPhase(phase).name.lower()}"
            for row in rows
            if (phase := phases[row]) in OUT and not self.excused[row]
        ]
        said += [
            f"{self._scene.agents[row].name} cannot get there: {self.no_way[row]}"
            for row in rows
            if row in self.no_way
        ]
        return ", ".join(said)

    def _failed(self, action: Action, rows: tuple[int, ...], why: str) -> Status:
        """Do what the mission says about a step that failed."""
        text = f"{action.place}: {action.verb} failed: {why}"
        if action.on_failure == "abort":
            self.reason = text
            return Status.FAILURE
        lost = {row for row in rows if self._health.phase[row] in OUT}
        leave = set(rows) if action.on_failure == "land" else lost
        self.left |= leave
        self._wishes.leave |= leave
        self._tell("failure", f"{text}; on_failure: {action.on_failure}")
        return Status.SUCCESS
