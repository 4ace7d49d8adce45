"""What becomes of the steps of a mission if nothing is in the way: how long, and at most how long.

Every step's task is made and begun where the steps before it lead, as in a flight, and told of
agents that fly exactly what it wants. So every time-out is the one that a flight would have there;
how long a step takes is what it takes without others, obstacles, drift and acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, TypeAlias

from star_core import Goals, Mission, Registry, StarError, Status, Task
from star_explain.stage import NO_TIME, Stage

TICK: Final = 0.1  # s of a rehearsal: finer tells no more of points that fly straight
LONGEST: Final = 600.0  # s for which one step is rehearsed
PATIENCE: Final = 5.0  # s, which a step may take longer than its condition waits, as in a flight


@dataclass(frozen=True, slots=True)
class Told:
    """What is known of one step.

    Attributes:
        action: The step, as the mission has it.
        agents: Names of those that do it.
        takes: How long it takes if nothing is in the way, s; None if that is not known.
        limit: Its time-out, s; None if that is not known.
        given: Whether the mission says the time-out.
        fault: Why it would fail, or why nothing is known of it; empty if it would not.
        on_board: Whether its agents fly trajectories on board, where nothing steers them.
    """

    action: Any
    agents: tuple[str, ...]
    takes: float | None
    limit: float | None
    given: bool
    fault: str
    on_board: bool = False


@dataclass(frozen=True, slots=True)
class Group:
    """Steps that are done at once, or one after the other.

    Attributes:
        at_once: Whether they are done at once.
        times: How often.
        parts: The steps.
    """

    at_once: bool
    times: int
    parts: tuple[Part, ...]

    @property
    def file(self) -> str:
        """The file that they stand in; empty if that is not known."""
        steps = [part.action.place for part in self.parts if isinstance(part, Told)]
        files = {place.rsplit(":", 2)[0] for place in steps}
        files = files or {part.file for part in self.parts if isinstance(part, Group)}
        return files.pop() if len(files) == 1 else ""

    @property
    def takes(self) -> float | None:
        """How long they take if nothing is in the way, s; None if that is not known."""
        return self._all([part.takes for part in self.parts])

    @property
    def limit(self) -> float | None:
        """How long they take at most, s; None if that is not known."""
        return self._all([part.limit for part in self.parts])

    def _all(self, times: Sequence[float | None]) -> float | None:
        known = [time for time in times if time is not None]
        if len(known) < len(times):
            return None
        return self.times * (max(known, default=0.0) if self.at_once else math.fsum(known))


Part: TypeAlias = Told | Group


def rehearse(mission: Mission, registry: Registry) -> Group:
    """Return what is known of a mission's steps."""
    return _Rehearsal(mission, registry).sequence(mission.steps, 1, 0.0)


def waits(condition: Mapping[str, Any]) -> float:
    """Return the longest time that a condition waits for as such, s; 0 if it names none.

    >>> waits({"any": [{"found": 1}, {"elapsed": 30}]})
    30.0
    """
    ((kind, given),) = condition.items()
    if kind in {"any", "all"}:
        return max(waits(inner) for inner in given)
    if kind == "not":
        return waits(given)
    return float(given) if kind == "elapsed" else 0.0


def holds_from(condition: Mapping[str, Any]) -> float:
    """Return from when on a condition holds that asks for nothing but time, s; else infinity.

    >>> holds_from({"any": [{"found": 1}, {"elapsed": 30}]}), holds_from({"found": 1})
    (30.0, inf)
    """
    ((kind, given),) = condition.items()
    if kind == "any":
        return min(holds_from(inner) for inner in given)
    if kind == "all":
        return max(holds_from(inner) for inner in given)
    return float(given) if kind == "elapsed" else math.inf


class _Rehearsal:
    """Goes through the steps of a mission once.

    Args:
        mission: What to rehearse.
        registry: Where its verbs are found.
    """

    def __init__(self, mission: Mission, registry: Registry) -> None:
        # No part may wait for anything where mission time goes on by itself.
        self._scene = replace(mission.scene, realtime=True, period=TICK)
        self._registry = registry
        self._stage = Stage(self._scene)
        self._out = set(mission.reserve_rows)
        self._on_board = False  # whether the step that is rehearsed is flown on board

    def sequence(self, nodes: Sequence[Any], times: int, begun: float) -> Group:
        """Do steps one after the other; of several rounds the first one is looked at."""
        parts: list[Part] = []
        for node in nodes:
            part = self._node(node, begun)
            begun += part.takes or 0.0
            parts.append(part)
        return Group(at_once=False, times=times, parts=tuple(parts))

    def _node(self, node: Any, begun: float) -> Part:
        if hasattr(node, "branches"):
            parts = tuple(self._node(branch, begun) for branch in node.branches)
            return Group(at_once=True, times=1, parts=parts)
        if hasattr(node, "times"):
            return self.sequence(node.steps, node.times, begun)
        return self._action(node, begun)

    def _action(self, action: Any, begun: float) -> Told:
        if action.verb == "join":
            self._out -= set(action.rows)
        rows = tuple(row for row in action.rows if row not in self._out)
        agents = tuple(self._scene.agents[row].name for row in rows)
        given = action.timeout is not None
        if not rows:
            return Told(action, agents, 0.0, 0.0, given, "nobody is left for it")
        self._on_board = False
        try:
            takes, limit, fault = self._rehearsed(action, rows, begun)
        except StarError as error:
            takes, limit, fault = None, action.timeout, str(error)
        except Exception as error:  # noqa: BLE001 -- whatever a plugin may raise
            what = f"task {action.verb!r} ({action.source}) raised {error!r}"
            takes, limit, fault = None, action.timeout, what
        if action.verb == "leave":
            self._out |= set(rows)
        return Told(action, agents, takes, limit, given, fault, self._on_board)

    def _rehearsed(
        self, action: Any, rows: tuple[int, ...], begun: float
    ) -> tuple[float | None, float, str]:
        """Do a step; return how long it takes and its time-out, s, and why it fails."""
        offer = self._registry.find("task", action.verb).offer
        outside = offer.options.get("outside")
        if outside and outside.get("unless") not in action.options:  # what a flight needs is left
            limit = outside["timeout"] if action.timeout is None else action.timeout
            return None, float(limit), ""
        task: Task = offer.make(self._scene, rows, **action.options)
        self._on_board = bool(getattr(task, "trajectories", ()))
        try:
            limit = self._limit(action, task, begun)
            takes, fault = self._perform(action, task, rows, begun, limit)
        finally:
            if (close := getattr(task, "close", None)) is not None:
                close()
        return takes, limit, fault

    def _limit(self, action: Any, task: Task, begun: float) -> float:
        """Begin a task and return the time-out of its step, as in a flight, s."""
        limit = float(task.begin(self._stage.estimate(begun), self._stage.health()))
        if action.until is not None:
            limit = max(limit, waits(action.until) + PATIENCE)
        return limit if action.timeout is None else float(action.timeout)

    def _perform(
        self, action: Any, task: Task, rows: tuple[int, ...], begun: float, limit: float
    ) -> tuple[float | None, str]:
        """Do a step; return how long it takes, s, None if that is not known, and why it fails."""
        end = math.inf if action.until is None else holds_from(action.until)
        goals: Goals | None = None
        for tick in range(math.ceil(min(limit, end, LONGEST) / TICK) + 1):
            now = begun + tick * TICK
            step = task.step(self._stage.estimate(now), self._stage.health())
            if step.status is Status.FAILURE:
                return None, step.reason or "failed and gave no reason"
            if step.status is Status.SUCCESS or tick * TICK >= end - NO_TIME:
                return tick * TICK, ""
            goals = step.goals or goals
            for command in step.commands:
                self._stage.obey(command, now)
            self._stage.move(goals, rows, now + TICK)
        late = action.until is None and limit <= LONGEST
        return None, "is not over when its time is, even if nothing is in the way" if late else ""
