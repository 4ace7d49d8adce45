"""Results of a rehearsal as a tree of the steps of the mission."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from star_core import Array, Mission, Registry
from star_core.toolkit import (
    Action,
    Choice,
    Node,
    Parallel,
    Reaction,
    Rehearsal,
    RehearsedStep,
    Repeat,
    actions,
)
from star_explain.origins import Origins
from star_explain.surroundings import Surroundings
from star_explain.variants import MAX_REACTIONS


@dataclass(frozen=True, slots=True)
class StepResult:
    """Result of one step.

    Attributes:
        action: The step of the mission.
        agents: Names of its agents.
        takes: Duration without disturbances, s; None if unknown; of several rounds, of the first.
        limit: Its timeout, s; None if unknown.
        fault: Why it would fail, or why nothing is known about it; empty otherwise.
        rounds: Each of its rounds in the rehearsal; none if no agents are left for it.
        blocked: Which obstacles are in the way of which agents, if the planner ignores them.
        surfaces: Over which surface each agent flies that is not as high as that of its start, if
            heights are measured from there.
        certain: Whether its agents begin it where the rehearsal has them: after a step that a
            condition ended, or of unknown duration, they may be elsewhere.
        anchored: Whether its agents begin it at goals that the mission names, and not above where
            they took off, which is known less exactly.
        ends: Goals of its agents at its end, (n, 3) m, if the check of the mission could not know
            them; empty otherwise.
    """

    action: Action
    agents: tuple[str, ...]
    takes: float | None
    limit: float | None
    fault: str
    rounds: tuple[RehearsedStep, ...] = ()
    blocked: tuple[str, ...] = ()
    surfaces: tuple[str, ...] = ()
    certain: bool = True
    anchored: bool = False
    ends: tuple[Array, ...] = ()

    @property
    def timed(self) -> bool:
        """Whether the mission sets its timeout."""
        return self.action.timeout is not None

    @property
    def late(self) -> bool:
        """Whether it fails by its timeout."""
        return any(step.outcome == "late" for step in self.rounds)

    @property
    def failed(self) -> bool:
        """Whether it fails for another reason, such as a goal where no agent can be."""
        return any(step.outcome == "failed" for step in self.rounds)

    @property
    def raised(self) -> bool:
        """Whether its task raises."""
        return any(step.outcome == "raised" for step in self.rounds)

    @property
    def on_board(self) -> bool:
        """Whether its agents fly trajectories on board, without steering."""
        return any(step.on_board for step in self.rounds)


GroupKind: TypeAlias = Literal["group", "choice", "branch", "reaction"]


@dataclass(frozen=True, slots=True)
class Group:
    """Steps that run in parallel or in sequence.

    Attributes:
        at_once: Whether they run in parallel.
        parts: The steps.
        times: Number of repetitions.
        title: When they run, if that depends on a condition; of both branches, the condition.
        kind: Of a reaction, which no other step leads to; of a choice, or one of its branches.
    """

    at_once: bool
    parts: tuple[Part, ...]
    times: int = 1
    title: str = ""
    kind: GroupKind = "group"

    @property
    def file(self) -> str:
        """The file that contains them; empty if unknown."""
        steps = [part.action.location for part in self.parts if isinstance(part, StepResult)]
        files = {location.rsplit(":", 2)[0] for location in steps}
        files = files or {part.file for part in self.parts if isinstance(part, Group)}
        return files.pop() if len(files) == 1 else ""

    @property
    def rounds(self) -> tuple[RehearsedStep, ...]:
        """All rounds of all its steps."""
        return tuple(step for part in self.parts for step in part.rounds)

    @property
    def takes(self) -> float | None:
        """Duration of all repetitions without disturbances, s; None if unknown."""
        rounds = self.rounds
        if any(step.duration is None for step in rounds):
            return None
        if not rounds:
            times = [part.takes for part in self.parts if part.takes is not None]
            return 0.0 if self.at_once else math.fsum(times)
        return max(step.ended for step in rounds) - min(step.begun for step in rounds)

    @property
    def limit(self) -> float | None:
        """Greatest duration, s; None if unknown."""
        limits = [part.limit for part in self.parts]
        bounds = [limit for limit in limits if limit is not None]
        if len(bounds) < len(limits):
            return None
        return self.times * (max(bounds, default=0.0) if self.at_once else math.fsum(bounds))


Part: TypeAlias = StepResult | Group


def results(mission: Mission, registry: Registry, rehearsal: Rehearsal, origins: Origins) -> Group:
    """Return the results of a mission's steps."""
    tree = _Tree(mission, registry, rehearsal, origins)
    parts = tuple(tree.of(step) for step in mission.steps)
    reactions = map(tree.reaction, mission.reactions, range(len(mission.reactions)))
    return Group(at_once=False, parts=(*parts, *reactions))


def steps_of(part: Part) -> Iterator[StepResult]:
    """Yield the results of all steps, in the order of the mission."""
    if isinstance(part, StepResult):
        yield part
        return
    for inner in part.parts:
        yield from steps_of(inner)


def with_others(group: Group, others: Sequence[Group]) -> Group:
    """Return results in which steps that are not reached have those of another variant."""
    inner = zip(group.parts, *(other.parts for other in others), strict=True)
    return replace(group, parts=tuple(_reached(first, rest) for first, *rest in inner))


def _reached(part: Part, others: Sequence[Part]) -> Part:
    if isinstance(part, Group):
        return with_others(part, [other for other in others if isinstance(other, Group)])
    reached = (other for other in others if isinstance(other, StepResult) and other.rounds)
    other = None if part.rounds else next(reached, None)
    return part if other is None else replace(other, rounds=())  # which would prolong groups


class _Tree:
    """Arranges the results of steps as the steps of the mission are."""

    def __init__(
        self, mission: Mission, registry: Registry, rehearsal: Rehearsal, origins: Origins
    ) -> None:
        self._scene = mission.scene
        self._rehearsal = rehearsal
        self._origins = origins
        self._surroundings = Surroundings(mission, registry, rehearsal)
        self._absent = "no agents are left for it"

    def of(self, node: Node) -> Part:
        """Return the results of a step."""
        match node:
            case Action():
                return self._action(node)
            case Parallel(branches):
                return Group(at_once=True, parts=tuple(map(self.of, branches)))
            case Repeat(times, steps):
                return self._sequence(steps, times=times)
            case Choice(when, _, steps, otherwise):
                sequences = [self._sequence(steps, title="if so", kind="branch")]
                if otherwise:
                    sequences.append(self._sequence(otherwise, title="otherwise", kind="branch"))
                parts = tuple(sequences)
                return Group(at_once=True, parts=parts, title=f"if {when}", kind="choice")

    def reaction(self, reaction: Reaction, number: int) -> Group:
        """Return the results of what is done on a condition, as the reaction with this number."""
        if number >= MAX_REACTIONS:
            self._absent = f"not rehearsed: only {MAX_REACTIONS} reactions are"
        steps, title = reaction.steps, f"on {reaction.when}"
        match steps:
            case (Parallel(branches),) if reaction.first:
                rehearsed = [
                    branch
                    for branch in branches
                    if any(id(action) in self._origins.rounds for action in actions([branch]))
                ]
                steps, title = tuple(rehearsed or branches)[:1], f"{title}: the first agent"
        return self._sequence(steps, title=title, kind="reaction")

    def _sequence(
        self, steps: Sequence[Node], *, times: int = 1, title: str = "", kind: GroupKind = "group"
    ) -> Group:
        parts = tuple(map(self.of, steps))
        return Group(at_once=False, times=times, parts=parts, title=title, kind=kind)

    def _action(self, action: Action) -> StepResult:
        rounds = tuple(self._origins.rounds.get(id(action), ()))
        if not rounds:
            return StepResult(action, (), 0.0, 0.0, self._absent)
        first, rehearsal = rounds[0], self._rehearsal
        relative = first.duration is not None and self._origins.is_relative(first)
        goals = rehearsal.last_goals(first)[list(first.rows)]
        return StepResult(
            action,
            tuple(self._scene.agents[row].name for row in first.rows),
            first.duration,
            first.timeout,
            next((step.problem for step in rounds if step.problem), ""),
            rounds,
            blocked=self._surroundings.blocked(rounds),
            surfaces=self._surroundings.surfaces(rounds),
            certain=self._origins.certain(action),
            anchored=self._origins.anchored(action),
            ends=tuple(goals) if relative else (),
        )
