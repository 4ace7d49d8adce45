"""Runs the steps of a mission: in order, at once, again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, TypeAlias

import numpy as np

from star_core.contracts import Status
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
from star_core.turn import Moment, Turn
from star_core.wishes import Wishes

OUT: Final = (AgentPhase.LOST, AgentPhase.EMERGENCY)
"""Phases in which an agent cannot go on with a step."""

Tell: TypeAlias = Callable[[str, str], None]


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
        self._wishes = Wishes.none(self._n)
        self.steps: list[dict[str, Any]] = []
        self._tasks = Prepared(mission, registry)
        self._wishes.uploaded = self._tasks.trajectories
        self._moment = Moment(self._scene, roster, self._tasks, self._wishes, events)
        self._running = self._sequence(mission.steps)
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
        out = np.flatnonzero(among(health.phase, *OUT) & ~self.excused)
        moment = self._moment
        moment.time, moment.estimate, moment.health = now, estimate, health
        moment.out, moment.refused, moment.no_way = set(out.tolist()), self.refused, self.no_way
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
                entry |= {"ended_s": self._moment.time, "outcome": "aborted"}
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
        while (answer := turn.step())[0] is Status.RUNNING:
            yield Status.RUNNING
        status, why = answer
        self._wishes.free.update(turn.rows)
        outcome = "success" if status is Status.SUCCESS else "failure"
        turn.entry |= {"ended_s": self._moment.time, "outcome": outcome}
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

    def _begin(self, action: Action, team: Team) -> Turn:
        """Begin a step for those that hold its places."""
        self._tell("step", f"{action.place}: {action.verb} begins for {team.names}")
        turn = Turn.begin(action, team, self._moment)
        for row in team.rows:
            for said in (self.no_way, self.refused):  # of the step before
                said.pop(row, None)
        self.steps.append(turn.entry)
        return turn

    def _team(self, places: tuple[int, ...]) -> Team:
        return Team.of(self._roster.holders(places), self._scene.names)

    def _failed(self, action: Action, rows: tuple[int, ...], why: str) -> Status:
        """Do what the mission says about a step that failed."""
        text = f"{action.place}: {action.verb} failed: {why}"
        if action.on_failure == "abort":
            self.reason = text
            return Status.FAILURE
        lost = {row for row in rows if self._moment.health.phase[row] in OUT}
        leave = set(rows) if action.on_failure == "land" else lost
        self._roster.vacate(leave, retire=action.on_failure == "land")
        self._wishes.leave |= leave
        self._tell("failure", f"{text}; on_failure: {action.on_failure}")
        return Status.SUCCESS
