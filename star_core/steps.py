"""The steps of a mission, as they were read: verbs, at once, one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from star_core.conditions import Condition
from star_core.registry import Source

OnFailure: TypeAlias = Literal["abort", "land", "continue"]


@dataclass(frozen=True, slots=True)
class Action:
    """One verb with its agents.

    Attributes:
        verb: The task that runs it.
        source: Whose task that is.
        rows: The agents it is for.
        options: What the task is made with.
        until: The condition that ends it, a success; None leaves its end to the task.
        timeout: How long it may take, s; None leaves that to the task.
        on_failure: What to do when it fails.
        place: ``file:line:col`` of the step.
    """

    verb: str
    source: Source
    rows: tuple[int, ...]
    options: Mapping[str, Any]
    until: Condition | None
    timeout: float | None
    on_failure: OnFailure
    place: str


@dataclass(frozen=True, slots=True)
class Parallel:
    """Steps that run at once; it is over when all of them are."""

    branches: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Repeat:
    """Steps that run one after the other, several times."""

    times: int
    steps: tuple[Node, ...]


Node: TypeAlias = Action | Parallel | Repeat


def actions(steps: Sequence[Node]) -> Iterator[Action]:
    """Every action of some steps, in the order of the file."""
    for step in steps:
        match step:
            case Action():
                yield step
            case Parallel(branches):
                yield from actions(branches)
            case Repeat(_, inner):
                yield from actions(inner)
