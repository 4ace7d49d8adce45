"""Variants of a mission that differ in what its conditions choose, so that all steps are tried."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from star_core import Mission
from star_core.formats import AllOf, Condition, Not, nodes
from star_core.toolkit import Choice, Node, Parallel, Repeat

ALWAYS: Final = AllOf(())
NEVER: Final = Not(ALWAYS)


def variants(mission: Mission) -> Iterator[Mission]:
    """Yield a mission, and if it chooses steps, one with each outcome of all choices.

    They consist of the same actions.
    """
    yield mission
    if any(isinstance(node, Choice) for node in nodes(mission.steps)):
        for outcome in (ALWAYS, NEVER):
            yield replace(mission, steps=_decided(mission.steps, outcome))


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
