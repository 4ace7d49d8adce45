"""Variants of a mission that differ in what its conditions choose, so that all steps are tried."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from star_core import AgentPhase, Mission
from star_core.formats import AllOf, Condition, ConditionContext, Not, nodes
from star_core.toolkit import Choice, Node, Parallel, Repeat

ALWAYS: Final = AllOf(())
NEVER: Final = Not(ALWAYS)


def variants(mission: Mission) -> Iterator[Mission]:
    """Yield a mission; if it chooses steps, one with each outcome of all choices; its reactions.

    Each of those comes once all agents fly. The variants consist of the same actions.
    """
    yield mission
    if any(isinstance(node, Choice) for node in nodes(mission.all_steps)):
        for outcome in (ALWAYS, NEVER):
            reactions = tuple(
                replace(reaction, steps=_decided(reaction.steps, outcome))
                for reaction in mission.reactions
            )
            steps = _decided(mission.steps, outcome)
            yield replace(mission, steps=steps, reactions=reactions)
    for i, reaction in enumerate(mission.reactions):
        others = mission.reactions[:i], mission.reactions[i + 1 :]
        comes = replace(reaction, when=AllFly())
        yield replace(mission, reactions=(*others[0], comes, *others[1]))


class AllFly(Condition):
    """All agents of the mission are in the air."""

    __slots__ = ()

    def holds(self, now: ConditionContext) -> bool:
        return all(now.health.phase[row] == AgentPhase.FLYING for row in now.rows)

    def __str__(self) -> str:
        return "all agents fly"


def _decided(steps: Sequence[Node], outcome: Condition) -> tuple[Node, ...]:
    """Return steps in which every choice has the same outcome."""
    return tuple(_with_outcome(step, outcome) for step in steps)


def _with_outcome(node: Node, outcome: Condition) -> Node:
    match node:
        case Parallel(branches):
            return replace(node, branches=_decided(branches, outcome))
        case Repeat(_, steps):
            return replace(node, steps=_decided(steps, outcome))
        case Choice(_, _, steps, otherwise):
            steps, otherwise = _decided(steps, outcome), _decided(otherwise, outcome)
            return replace(node, when=outcome, steps=steps, otherwise=otherwise)
    return node
