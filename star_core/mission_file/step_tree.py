"""The steps of a mission, as they were read: verbs, at once, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from star_core.mission_file.conditions import Condition
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


Raw: TypeAlias = Mapping[str, Any]
"""A step as plain data: its verb and what is given."""
Place: TypeAlias = tuple[str | int, ...]


def within(steps: Iterable[Raw], path: Place) -> Iterator[tuple[Raw, Place]]:
    """Every step with a verb of its own in some steps, and every ``each``, with its place."""
    for i, step in enumerate(steps):
        ((verb, given),) = step.items()
        if verb == "parallel":
            yield from within(given, (*path, i, verb))
        elif verb == "repeat":
            yield from within(given["steps"], (*path, i, verb, "steps"))
        else:
            yield step, (*path, i)


def begun(
    step: Raw, path: Place, rows_of: Callable[[Any], Sequence[int]]
) -> Iterator[tuple[Place, str, Raw]]:
    """The verbs with which a step begins, each as often as it is done, with places and options.

    Args:
        step: Of the mission.
        path: Where it is.
        rows_of: Returns the agents that a step names.
    """
    ((verb, given),) = step.items()
    here = (*path, verb)
    if verb == "parallel":
        for i, branch in enumerate(given):
            yield from begun(branch, (*here, i), rows_of)
    elif verb == "repeat":
        yield from begun(given["steps"][0], (*here, "steps", 0), rows_of)
    elif verb == "each":
        for _ in rows_of(given.get("agents", "all")):
            yield from begun(given["steps"][0], (*here, "steps", 0), rows_of)
    else:
        yield here, verb, given
