"""One step of a mission under way: who does it, how far it is, and why it failed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, Final, Self

import numpy as np

from star_core.blame import Blame
from star_core.conditions import Situation, holds, longest
from star_core.conformance import expect
from star_core.contracts import Status, Step, Task
from star_core.errors import ContractError
from star_core.flight import Event
from star_core.prepared import Prepared
from star_core.roster import Roster, Team
from star_core.scene import Scene
from star_core.steps import Action
from star_core.swarm import AgentPhase, Estimate, Health
from star_core.wishes import Wishes

THERE: Final = 0.05
"""How near to its goal an agent is there, in what is said of a time-out, m."""

PATIENCE: Final = 5.0
"""How much longer a step may take than its condition waits for, s."""


@dataclass(slots=True)
class Moment:
    """What all steps under way go by.

    Attributes:
        scene: What does not change.
        roster: Who is in the mission.
        tasks: What decides, made before take-off.
        wishes: Where all that is wanted in a tick goes.
        events: Everything that is told in the flight, the newest last.
        targets: Names of the world's targets, in its order.
        time: Mission time, s.
        estimate: Where the agents are.
        health: How they are.
        out: Rows of those that cannot go on.
        refused: What agents will not do, by row.
        no_way: Why there is no way to an agent's goal, by row.
    """

    scene: Scene
    roster: Roster
    tasks: Prepared
    wishes: Wishes
    events: Sequence[Event]
    targets: tuple[str, ...] = field(init=False)
    time: float = field(init=False, default=0.0)
    estimate: Estimate = field(init=False)
    health: Health = field(init=False)
    out: set[int] = field(init=False)
    refused: dict[int, str] = field(init=False)
    no_way: dict[int, str] = field(init=False)

    def __post_init__(self) -> None:
        self.targets = tuple(dict.fromkeys(tag.of for tag in self.scene.world.targets))


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
        entry: What ``summary.json`` says of it.
        moment: What it goes by.
    """

    action: Action
    team: Team
    seen: int
    task: Task
    blame: Blame
    limit: float
    begun: float
    entry: dict[str, Any]
    moment: Moment

    @classmethod
    def begin(cls, action: Action, team: Team, moment: Moment) -> Self:
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
            return Status.FAILURE, "nobody is left for it"
        wishes.doing.append(f"{self.action.verb} {self.team.names}")
        if why := self._gone():
            return Status.FAILURE, why
        with self.blame:
            step = expect(self.task.step(now.estimate, now.health), Step)
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

        A task that cannot be told is begun anew. Whoever fills a place that was empty is in the
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
        told: tuple[Any, ...] = tuple(
            getattr(self.task, name, None) for name in ("swap", "stay", "join")
        )
        swap, stay, join = told
        if not kept:
            return
        if (swaps and swap is None) or (len(kept) < len(before) and stay is None):
            wishes.free.update(self.rows)
            task, _ = self.moment.tasks.take(self.action, self.rows)
            self.task, limit = task, _started(self.action, task, self.blame, self.moment)
            if self.action.timeout is None:
                self.limit = self.moment.time - self.begun + limit
            return
        with self.blame:
            for old, new in swaps:
                swap(old, new)
            if len(kept) < len(before):
                stay(self.rows)
            if len(kept) < len(now) and join is not None:
                self.team = Team.of(now, self.moment.scene.names)
                join(self.rows)

    def _fulfilled(self) -> bool:
        """Whether the condition holds that ends it."""
        until, moment = self.action.until, self.moment
        if until is None:
            return False
        finder = moment.health.finder.tolist()
        found = [name for name, row in zip(moment.targets, finder, strict=True) if row >= 0]
        now = Situation(
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
        if not now.out and not now.no_way and not now.refused:
            return ""
        phase, names = now.health.phase, now.scene.names
        said = [
            f"{names[row]} is {AgentPhase(int(phase[row])).name.lower()}"
            for row in self.rows
            if row in now.out
        ]
        said += [f"{names[row]} {now.refused[row]}" for row in self.rows if row in now.refused]
        said += [
            f"{names[row]} cannot get there: {now.no_way[row]}"
            for row in self.rows
            if row in now.no_way
        ]
        return ", ".join(said)


def _started(action: Action, task: Task, blame: Blame, moment: Moment) -> float:
    """Start a task; return the time-out of its step, s."""
    with blame:
        limit = task.begin(moment.estimate, moment.health)
        if not isinstance(limit, Real) or not 0 < limit < np.inf:
            raise ContractError(f"begin() returned {limit!r}, expected how long it takes, s")
        limit = float(limit)
    if action.until is not None:
        limit = max(limit, longest(action.until) + PATIENCE)
    return limit if action.timeout is None else action.timeout
