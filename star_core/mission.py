"""A mission: what to fly, with which plugins."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

from star_core.conditions import Condition
from star_core.discovery import Source
from star_core.errors import SourceFile
from star_core.world.scene import Scene

OnFailure: TypeAlias = Literal["abort", "land", "continue"]


@dataclass(frozen=True, slots=True)
class Action:
    """One verb with its agents.

    Attributes:
        verb: Name of its task.
        source: Distribution of the task.
        rows: Its agents.
        options: Options of the task, with the defaults of its schema.
        until: The condition that ends it successfully; None if the task ends by itself.
        timeout: Time after which it fails, s; None if the task derives it.
        on_failure: What happens when it fails.
        location: In the source, ``file:line:col``.
        included_from: Locations of the ``include`` steps that it comes from, the outermost first.
        path: Keys and indices from the top of the mission to the step.
        known: Whether all of it could be interpreted.
        written: All options of the step as the mission has them, `until` and the like included.
    """

    verb: str
    source: Source
    rows: tuple[int, ...]
    options: Mapping[str, Any]
    until: Condition | None
    timeout: float | None
    on_failure: OnFailure
    location: str
    included_from: tuple[str, ...] = ()
    path: tuple[str | int, ...] = ()
    known: bool = True
    written: Mapping[str, Any] = field(default_factory=dict)

    @property
    def at(self) -> tuple[str | int, ...]:
        """The path of the verb's options in the document."""
        return (*self.path, self.verb)

    @property
    def label(self) -> str:
        """File, line and verb, for messages: ``tour.yaml:3 (from patrol.yaml:5) goto``."""
        origin = ", ".join(_short(location) for location in reversed(self.included_from))
        return f"{_short(self.location)}{f' (from {origin})' if origin else ''} {self.verb}"


@dataclass(frozen=True, slots=True)
class Parallel:
    """Steps that run at once; it is over when all of them are.

    Attributes:
        branches: One step each; of ``each``, one sequence for each agent.
        at: The path of its branches in the document.
        each: Whether it is an ``each``.
    """

    branches: tuple[Node, ...]
    at: tuple[str | int, ...] = ()
    each: bool = False


@dataclass(frozen=True, slots=True)
class Repeat:
    """Steps that run one after the other, several times."""

    times: int
    steps: tuple[Node, ...]
    at: tuple[str | int, ...] = ()


@dataclass(frozen=True, slots=True)
class Choice:
    """Steps that depend on a condition when they are reached.

    Attributes:
        when: The condition; an event in it happened at any time before.
        rows: The agents that it is about unless it names others.
        steps: If it holds, one after the other.
        otherwise: If it does not, one after the other.
        location: In the source, ``file:line:col``.
        at: The path of its options in the document.
    """

    when: Condition
    rows: tuple[int, ...]
    steps: tuple[Node, ...]
    otherwise: tuple[Node, ...]
    location: str = ""
    at: tuple[str | int, ...] = ()

    @property
    def label(self) -> str:
        """File, line and condition, for messages: ``tour.yaml:3 if 2 targets are found``."""
        return f"{_short(self.location)} if {self.when}"


Node: TypeAlias = Action | Parallel | Repeat | Choice


@dataclass(frozen=True, slots=True)
class Reaction:
    """Steps that replace, once, what their agents do when a condition comes true.

    Attributes:
        when: The condition; it is about all agents unless it names others.
        steps: One after the other.
        location: In the source, ``file:line:col``.
        at: Its path in the document.
        first: Whether only the first agent reacts for which the condition holds. The only step is
            then a `Parallel` with a branch for each agent.
    """

    when: Condition
    steps: tuple[Node, ...]
    location: str = ""
    at: tuple[str | int, ...] = ()
    first: bool = False

    @property
    def label(self) -> str:
        """File, line and condition, for messages: ``tour.yaml:3 on 2 targets are found``."""
        return f"{_short(self.location)} on {self.when}"

    @property
    def first_actions(self) -> Mapping[int, Action]:
        """The action with which each of its agents begins, by row."""
        first: dict[int, Action] = {}
        for action in actions(self.steps):
            for row in action.rows:
                first.setdefault(row, action)
        return first

    def steps_of(self, slots: Collection[int]) -> tuple[Node, ...]:
        """The steps for some agents, by row."""
        match self.steps:
            case (Parallel(branches),) if self.first:
                return tuple(branches[slot] for slot in slots)
        return self.steps


def nodes(steps: Sequence[Node], *, first: bool = False) -> Iterator[Node]:
    """Yield every step, each before the steps in it, in the order of the file.

    Args:
        steps: One after the other, or at once.
        first: Whether to yield, of the steps in a ``repeat`` and of each branch of a ``Choice``,
            only the one with which it begins.
    """
    for step in steps:
        yield step
        match step:
            case Parallel(branches):
                yield from nodes(branches, first=first)
            case Repeat(_, inner):
                yield from nodes(inner[:1] if first else inner, first=first)
            case Choice():
                for branch in (step.steps, step.otherwise):
                    yield from nodes(branch[:1] if first else branch, first=first)


def changed(steps: Sequence[Node], change: Callable[[Node], Node]) -> tuple[Node, ...]:
    """Return steps in which `change` has replaced each, those inside of others first."""
    return tuple(change(_with_changed_inner(step, change)) for step in steps)


def _with_changed_inner(step: Node, change: Callable[[Node], Node]) -> Node:
    match step:
        case Parallel(branches):
            return replace(step, branches=changed(branches, change))
        case Repeat(_, steps):
            return replace(step, steps=changed(steps, change))
        case Choice(_, _, steps, otherwise):
            steps, otherwise = changed(steps, change), changed(otherwise, change)
            return replace(step, steps=steps, otherwise=otherwise)
    return step


def actions(steps: Sequence[Node], *, first: bool = False) -> Iterator[Action]:
    """Yield every action of some steps, as `nodes` does."""
    return (node for node in nodes(steps, first=first) if isinstance(node, Action))


@dataclass(frozen=True, slots=True)
class PluginChoice:
    """A plugin that a mission uses.

    Attributes:
        kind: Of the plugin.
        use: Its name.
        options: Its options, with the defaults of its schema.
        source: Its origin.
        written: Its options as the mission has them.
    """

    kind: str
    use: str
    options: Mapping[str, Any]
    source: Source
    written: Mapping[str, Any]

    def __str__(self) -> str:
        return f"{self.kind} {self.use!r} ({self.source})"


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Mission:
    """What to fly. Missions are equal only if they are the same object.

    Attributes:
        name: For records.
        scene: What every plugin is made with.
        plugins: The transport, localizer, planner and avoider, by kind.
        steps: What to do, one after the other.
        reactions: What to do instead when conditions come true, the most important first.
        safety: What becomes of agents in trouble, by the trouble.
        reserve: Agents that replace others, and when; empty if there are none.
        plugin_strikes: Number of failures of a plugin in flight at which all agents land.
        collisions: ``fail`` if a collision fails the mission, ``record`` if it is only recorded.
        source: Content of the file, with what it includes and what was set on the command line.
        file: Its file, in which problems are located.
        world_file: That of its world.
        files: Files whose content is in `source`, besides its own.
        warnings: What is probably a mistake, one line each, with its location.
    """

    name: str
    scene: Scene
    plugins: Mapping[str, PluginChoice]
    steps: tuple[Node, ...]
    safety: Mapping[str, Mapping[str, Any]]
    reserve: Mapping[str, Any]
    plugin_strikes: int
    collisions: str
    source: Mapping[str, Any]
    file: SourceFile
    world_file: SourceFile
    files: tuple[Path, ...] = ()
    warnings: tuple[str, ...] = ()
    reactions: tuple[Reaction, ...] = ()

    @property
    def all_steps(self) -> tuple[Node, ...]:
        """Its steps, and those of its reactions."""
        return (*self.steps, *(step for reaction in self.reactions for step in reaction.steps))

    def with_steps(self, change: Callable[[Node], Node]) -> Mission:
        """Return the same mission with every step, those of reactions too, replaced by `change`."""
        reactions = tuple(replace(r, steps=changed(r.steps, change)) for r in self.reactions)
        return replace(self, steps=changed(self.steps, change), reactions=reactions)

    def with_seed(self, seed: int) -> Mission:
        """Return the same mission with another seed."""
        scene, source = replace(self.scene, seed=seed), {**self.source, "seed": seed}
        return replace(self, scene=scene, source=source)

    @property
    def reserve_rows(self) -> tuple[int, ...]:
        """Rows of the agents that are in reserve at the start."""
        return tuple(self.scene.names.index(name) for name in self.reserve.get("agents", ()))


def _short(location: str) -> str:
    """Return a location without folder and column.

    >>> _short("missions/patrol.yaml:5:3"), _short("--set mission=[]")
    ('patrol.yaml:5', '--set mission=[]')
    """
    match = re.fullmatch(r"(?:.*/)?([^/]+:\d+):\d+", location)
    return match[1] if match else location
