"""Variants of a mission that differ in what its conditions choose, so that all steps are tried."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from star_core import AgentPhase, Mission
from star_core.formats import Condition, ConditionContext, nodes
from star_core.toolkit import Choice, Node

MAX_REACTIONS: Final = 10  # with a variant each: every one takes a rehearsal


def variants(mission: Mission) -> Iterator[Mission]:
    """Yield a mission; if it chooses steps, one with each outcome of all choices; its reactions.

    A variant for each of the first `MAX_REACTIONS` reactions has it come once all agents fly. All
    consist of the same actions.
    """
    yield mission
    if any(isinstance(node, Choice) for node in nodes(mission.all_steps)):
        for holds in (True, False):
            yield mission.with_steps(partial(_decided, outcome=Decided(holds)))
    for i, reaction in enumerate(mission.reactions[:MAX_REACTIONS]):
        others = mission.reactions[:i], mission.reactions[i + 1 :]
        comes = replace(reaction, when=AllFly())
        yield replace(mission, reactions=(*others[0], comes, *others[1]))


@dataclass(frozen=True, slots=True)
class Decided(Condition):
    """Always, or never."""

    outcome: bool

    def holds(self, now: ConditionContext) -> bool:
        return self.outcome

    def __str__(self) -> str:
        return "always" if self.outcome else "never"


class AllFly(Condition):
    """All agents of the mission are in the air."""

    __slots__ = ()

    def holds(self, now: ConditionContext) -> bool:
        return all(now.health.phase[row] == AgentPhase.FLYING for row in now.rows)

    def __str__(self) -> str:
        return "all agents fly"


def _decided(node: Node, outcome: Condition) -> Node:
    """Return a step which, if it is a choice, has this outcome."""
    return replace(node, when=outcome) if isinstance(node, Choice) else node
