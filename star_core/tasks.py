"""Runs the steps of a mission: in order, at once, again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, Final, TypeAlias

import numpy as np

from star_core.blame import Blame
from star_core.conditions import Situation, holds, longest
from star_core.conformance import expect
from star_core.contracts import Status, Step, Task
from star_core.errors import ContractError
from star_core.flight import Event
from star_core.mission import Mission
from star_core.options import JOIN, LEAVE
from star_core.orders import Trajectory
from star_core.prepared import Prepared
from star_core.registry import Registry
from star_core.roster import Roster, Team
from star_core.steps import Action, Node, Parallel, Repeat
from star_core.swarm import AgentPhase, Estimate, Health, among
from star_core.table import Mask
from star_core.wishes import Wishes

OUT: Final = (AgentPhase.LOST, AgentPhase.EMERGENCY)
"""Phases in which an agent cannot go on with a step."""

THERE: Final = 0.05
"""How near to its goal an agent is there, in what is said of a time-out, m."""

PATIENCE: Final = 5.0
"""How much longer a step may take than its condition waits for, s."""


Tell: TypeAlias = Callable[[str, str], None]


@dataclass(slots=True)
class Turn:
    """A step under way.

    Attributes:
        action: What is done.
        team: Who does it.
        seen: The version of the roster that `team` is of.
        task: What decides, as a plugin made it.
        blame: Whose fault it is if that raises.
        limit: How long it may take, s.
        begun: When it began, s.
        entry: What `Course.steps` says of it.
    """

    action: Action
    team: Team
    seen: int
    task: Task
    blame: Blame
    limit: float
    begun: float
    entry: dict[str, Any]

    @property
    def rows(self) -> tuple[int, ...]:
        """Rows of the agents that do it."""
        return self.team.rows


class Course:
    """The steps of a mission as they are flown.

    Args:
        mission: What to fly.
        registry: Where its verbs are found.
        roster: Who is in the mission; an agent that leaves its place leaves its steps.
        tell: Told of each step's begin and end: kind and text.
        events: Everything that is told in the flight, the newest last.

    Attributes:
        excused: (N,) who may be lost without failing its step; to be set before each tick.
        reason: Why the mission failed, once it has.
        refused: What agents will not do, by row; to be set before each tick.
        no_way: Why there is no way to an agent's goal, by row; to be set after each tick.
        steps: What was begun and how it ended, as ``summary.json`` keeps it.
    """

    def __init__(
        self,
        mission: Mission,
        registry: Registry,
        roster: Roster,
        tell: Tell,
        events: Sequence[Event],
    ) -> None:
        self._scene = mission.scene
        self._n = len(self._scene.agents)
        self._roster = roster
        self._tell = tell
        self._events = events
        self._targets = tuple(dict.fromkeys(tag.of for tag in self._scene.world.targets))
        self._wishes = Wishes.none(self._n)
        self.steps: list[dict[str, Any]] = []
        self._tasks = Prepared(mission, registry)
        self._wishes.uploaded = self._tasks.trajectories
        self._running = self._sequence(mission.steps)
        self._now = 0.0
        self._out: set[int] = set()  # rows of those that cannot go on
        self._estimate: Estimate
        self._health: Health
        self.excused: Mask = np.zeros(self._n, np.bool_)
        self.reason = ""
        self.refused: dict[int, str] = {}
        self.no_way: dict[int, str] = {}

    @property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """What its tasks may order to be flown on board, each once."""
        return self._tasks.trajectories

    def step(self, now: float, estimate: Estimate, health: Health) -> tuple[Status, Wishes]:
        """Run one tick of every step under way; all that is wanted is in the answer.

        Time-outs go by mission time, `now`, s: an estimate is only as new as what was heard.
        """
        self._now, self._estimate, self._health = now, estimate, health
        self._out = set(np.flatnonzero(among(health.phase, *OUT) & ~self.excused).tolist())
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
        self._roster.vacate([row])
        self._wishes.active[row] = False
        alone = np.zeros(self._n, np.bool_)
        alone[row] = True
        self.hold(alone & estimate.valid, estimate)

    def close(self) -> list[str]:
        """Close every task that can be closed; return what went wrong.

        Steps that are under way have been aborted.
        """
        for entry in self.steps:
            if entry["outcome"] is None:
                entry |= {"ended_s": self._now, "outcome": "aborted"}
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
            self._tell("step", f"{action.place}: {action.verb} is left out: nobody is left for it")
            yield Status.SUCCESS
            return
        turn = self._begin(action, team)
        while (now := self._step(turn))[0] is Status.RUNNING:
            yield Status.RUNNING
        status, why = now
        self._wishes.free.update(turn.rows)
        outcome = "success" if status is Status.SUCCESS else "failure"
        turn.entry |= {"ended_s": self._now, "outcome": outcome}
        if status is Status.FAILURE and turn.rows:
            yield self._failed(action, turn.rows, why)
            return
        if status is Status.FAILURE:  # its agents left the mission, and the others need not know
            self._tell("failure", f"{action.place}: {action.verb} failed: {why}")
            yield Status.SUCCESS
            return
        self._tell("step", f"{action.place}: {action.verb} is done")
        if action.verb == LEAVE:
            self._roster.vacate(turn.rows, retire=True)
        yield Status.SUCCESS

    def _muster(self, action: Action) -> None:
        """Let agents that are in reserve be in the mission."""
        for place in action.rows:
            if place in self._roster.retired:
                self._roster.take(place, place)

    def _step(self, turn: Turn) -> tuple[Status, str]:
        """Run one tick of a step; return how far it is, and why it failed."""
        action = turn.action
        if turn.seen != self._roster.version:
            self._hand_on(turn)
        if not turn.rows:
            return Status.FAILURE, "nobody is left for it"
        self._wishes.doing.append(f"{action.verb} {turn.team.names}")
        if why := self._gone(turn.rows):
            return Status.FAILURE, why
        with turn.blame:
            step = expect(turn.task.step(self._estimate, self._health), Step)
            if not isinstance(step.status, Status):
                raise ContractError(f"Step.status is {step.status!r}, expected a Status")
            self._wishes.add(step, turn.team.own)
        if step.status is Status.SUCCESS or self._fulfilled(turn):
            return Status.SUCCESS, ""
        if step.status is Status.FAILURE:
            return Status.FAILURE, step.reason or "failed and gave no reason"
        if self._now - turn.begun >= turn.limit:
            return Status.FAILURE, f"timed out after {turn.limit:.3g} s{self._behind(turn.rows)}"
        return Status.RUNNING, ""

    def _behind(self, rows: tuple[int, ...]) -> str:
        """What keeps agents from being done, as far as the core can see."""
        said = []
        for row in rows:
            name, phase = self._scene.agents[row].name, AgentPhase(self._health.phase[row])
            away = self._wishes.position[row] - self._estimate.position[row]
            if not self._estimate.valid[row]:
                said.append(f"{name} is not located")
            elif phase is not AgentPhase.FLYING:
                said.append(f"{name} is {phase.name.lower().replace('_', ' ')}")
            elif self._wishes.active[row] and (far := float(np.linalg.norm(away))) > THERE:
                said.append(f"{name} is {far:.2f} m from its goal")
        return f": {', '.join(said)}" if said else ""

    def _begin(self, action: Action, team: Team) -> Turn:
        """Begin a step for those that hold its places."""
        seen, rows = self._roster.version, team.rows
        self._tell("step", f"{action.place}: {action.verb} begins for {team.names}")
        task, blame = self._tasks.take(action, rows)
        task, limit = self._started(action, task, blame)
        for row in rows:
            for said in (self.no_way, self.refused):  # of the step before
                said.pop(row, None)
        entry = {
            "place": action.place,
            "verb": action.verb,
            "agents": [self._scene.agents[row].name for row in rows],
            "begun_s": self._now,
            "ended_s": None,
            "outcome": None,
        }
        self.steps.append(entry)
        return Turn(action, team, seen, task, blame, limit, self._now, entry)

    def _started(self, action: Action, task: Task, blame: Blame) -> tuple[Task, float]:
        """Start a task; return it with the time-out of its step, s."""
        with blame:
            limit = task.begin(self._estimate, self._health)
            if not isinstance(limit, Real) or not 0 < limit < np.inf:
                raise ContractError(f"begin() returned {limit!r}, expected how long it takes, s")
            limit = float(limit)
        if action.until is not None:
            limit = max(limit, longest(action.until) + PATIENCE)
        return task, limit if action.timeout is None else action.timeout

    def _team(self, places: tuple[int, ...]) -> Team:
        return Team.of(self._roster.holders(places), self._scene.names)

    def _hand_on(self, turn: Turn) -> None:
        """Let a step go on with those that hold its places now.

        A task that cannot be told is begun anew. Whoever fills a place that was empty is in the
        next step only, if the task cannot be told of it.
        """
        turn.seen = self._roster.version
        before, now = turn.team.holders, self._roster.holders(turn.action.rows)
        if now == before:
            return
        self._wishes.free |= set(before.values()) - set(now.values())
        kept = {place: now[place] for place in before if place in now}
        swaps = [(before[place], row) for place, row in kept.items() if before[place] != row]
        turn.team = Team.of(kept, self._scene.names)
        told: tuple[Any, ...] = tuple(
            getattr(turn.task, name, None) for name in ("swap", "stay", "join")
        )
        swap, stay, join = told
        if not kept:
            return
        if (swaps and swap is None) or (len(kept) < len(before) and stay is None):
            self._wishes.free.update(turn.rows)
            task, _ = self._tasks.take(turn.action, turn.rows)
            turn.task, limit = self._started(turn.action, task, turn.blame)
            if turn.action.timeout is None:
                turn.limit = self._now - turn.begun + limit
            return
        with turn.blame:
            for old, new in swaps:
                swap(old, new)
            if len(kept) < len(before):
                stay(turn.rows)
            if len(kept) < len(now) and join is not None:
                turn.team = Team.of(now, self._scene.names)
                join(turn.rows)

    def _fulfilled(self, turn: Turn) -> bool:
        """Whether the condition holds that ends a step."""
        until = turn.action.until
        if until is None:
            return False
        finder = self._health.finder.tolist()
        found = [name for name, row in zip(self._targets, finder, strict=True) if row >= 0]
        now = Situation(
            rows=turn.rows,
            begun=turn.begun,
            time=self._now,
            estimate=self._estimate,
            health=self._health,
            names=self._scene.names,
            targets=found,
            events=self._events,
        )
        return holds(until, now)

    def _gone(self, rows: tuple[int, ...]) -> str:
        """Say which agents of a step cannot go on, if any."""
        if not self._out and not self.no_way and not self.refused:
            return ""
        phase, names = self._health.phase, self._scene.names
        said = [
            f"{names[row]} is {AgentPhase(int(phase[row])).name.lower()}"
            for row in rows
            if row in self._out
        ]
        said += [f"{names[row]} {self.refused[row]}" for row in rows if row in self.refused]
        said += [
            f"{names[row]} cannot get there: {self.no_way[row]}"
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
        self._roster.vacate(leave, retire=action.on_failure == "land")
        self._wishes.leave |= leave
        self._tell("failure", f"{text}; on_failure: {action.on_failure}")
        return Status.SUCCESS
