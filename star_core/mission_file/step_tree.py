"""The steps of a mission as a tree: built once, tolerant of mistakes, and traversed by all checks.

What a step lacks because of a mistake that its schema reports, is marked (`Action.known`), so that
the mistakes of all other steps are found in the same run.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal, TypeAlias

from star_core.errors import MAX_LISTED, PluginError, suggestion
from star_core.mission_file.conditions import Condition
from star_core.mission_file.located import Document, Location
from star_core.mission_file.schema import UNKNOWN, Incomplete, Refused
from star_core.plugin_support.discovery import Source
from star_core.plugin_support.option_schema import JOIN, SHARED, fill_defaults
from star_core.plugin_support.specs import Problem
from star_core.registry import Registry
from star_core.scene import Scene

OnFailure: TypeAlias = Literal["abort", "land", "continue"]
Groups: TypeAlias = Mapping[str, tuple[int, ...]]
"""Rows by the name of an agent or a group, or ``all``."""


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
        path: Of the step in the document.
        known: Whether all of it could be interpreted.
        written: Options of the task, as the mission has them.
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
    path: Location = ()
    known: bool = True
    written: Mapping[str, Any] = field(default_factory=dict)

    @property
    def at(self) -> Location:
        """The path of the verb's options in the document."""
        return (*self.path, self.verb)

    @property
    def label(self) -> str:
        """File, line and verb, for messages: ``tour.yaml:3 (from patrol.yaml:5) goto``."""
        origin = ", ".join(_short(one) for one in reversed(self.included_from))
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
    at: Location = ()
    each: bool = False


@dataclass(frozen=True, slots=True)
class Repeat:
    """Steps that run one after the other, several times."""

    times: int
    steps: tuple[Node, ...]
    at: Location = ()


Node: TypeAlias = Action | Parallel | Repeat


def nodes(steps: Sequence[Node], *, first: bool = False) -> Iterator[Node]:
    """Yield every step, each before the steps in it, in the order of the file.

    Args:
        steps: One after the other, or at once.
        first: Whether to yield, of the steps in a ``repeat``, only the one with which it begins.
    """
    for step in steps:
        yield step
        match step:
            case Parallel(branches):
                yield from nodes(branches, first=first)
            case Repeat(_, inner):
                yield from nodes(inner[:1] if first else inner, first=first)


def actions(steps: Sequence[Node], *, first: bool = False) -> Iterator[Action]:
    """Yield every action of some steps, as `nodes` does."""
    return (node for node in nodes(steps, first=first) if isinstance(node, Action))


def rows_of(given: str | list[str], groups: Groups) -> tuple[int, ...]:
    """Return the rows of a step's ``agents``, each once, in the order of the swarm."""
    names = [given] if isinstance(given, str) else given
    return tuple(sorted({row for name in names for row in groups.get(name, ())}))


class StepBuilder:
    """Builds the steps of a mission.

    Args:
        document: The mission.
        refused: What its schema refuses.
        scene: For the names of agents and groups.
        uncertain: Names of groups whose agents are not known; None if not even the names are.
        registry: Registry of the verbs.

    Attributes:
        problems: Names of agents that do not exist, or are where they have no meaning.
    """

    def __init__(
        self,
        document: Document,
        refused: Refused,
        scene: Scene,
        uncertain: set[str] | None,
        registry: Registry,
    ) -> None:
        self.problems: list[Problem] = []
        self._document = document
        self._refused = refused
        self._uncertain = uncertain
        self._registry = registry
        self._groups: Groups = scene.rows_by_name

    def build(self) -> tuple[Node, ...]:
        """Return the steps of the mission."""
        return self._steps(self._document.data.get("mission"), ("mission",), self._groups)

    def _steps(self, given: Any, path: Location, groups: Groups) -> tuple[Node, ...]:
        if not isinstance(given, list) or path in self._refused:
            return ()
        return tuple(self._step(step, (*path, i), groups) for i, step in enumerate(given))

    def _step(self, step: Any, path: Location, groups: Groups) -> Node:
        legible = isinstance(step, dict) and path not in self._refused
        verbs = [verb for verb in step if (*path, verb) not in self._refused] if legible else []
        if len(verbs) != 1:
            return self._unknown(path)
        verb, given, at = verbs[0], step[verbs[0]], (*path, verbs[0])
        if verb == "parallel":
            branches = self._steps(given, at, groups)
            return Parallel(branches, at) if branches else self._unknown(path)
        if not isinstance(given, dict) or verb == "include":  # which could not be read
            return self._unknown(path)
        options = {key: one for key, one in given.items() if key != "steps"}
        options = self._refused.without(options, at)
        if verb == "repeat":
            inner = self._steps(given.get("steps"), (*at, "steps"), groups)
            return Repeat(options.get("times", 1), inner, at) if inner else self._unknown(path)
        known = not isinstance(options, Incomplete) and len(step) == 1
        rows, named = self._rows(options, at, groups, known=known)
        known = known and named
        if verb == "each":
            return self._each(given, path, rows if known else ())
        action = self._action(verb, options, path, rows)
        if verb == JOIN and "agents" not in options and "each" not in path:
            self._report(at, f"{verb}: missing option 'agents'", "missing-option")
        return action if known else replace(action, known=False)

    def _each(self, given: Mapping[str, Any], path: Location, rows: tuple[int, ...]) -> Node:
        at = (*path, "each")
        sequences = [
            Repeat(1, self._steps(given.get("steps"), (*at, "steps"), {"all": (row,)}), at)
            for row in rows
        ]
        if not sequences or not sequences[0].steps:
            return self._unknown(path)
        return Parallel(tuple(sequences), at, each=True)

    def _action(
        self, verb: str, options: Mapping[str, Any], path: Location, rows: tuple[int, ...]
    ) -> Action:
        known, source = True, Source("")
        written = {key: value for key, value in options.items() if key not in SHARED}
        filled: Mapping[str, Any] = written
        try:
            task = self._registry.find("task", verb)
            source, filled = task.source, fill_defaults(written, task.offer.options)
        except PluginError as error:
            self._report((*path, verb), error.message, error.code)
            known = False
        until = options.get("until")
        return Action(
            verb=verb,
            source=source,
            rows=rows,
            options=filled,
            until=None if isinstance(until, Incomplete) else until,
            timeout=options.get("timeout"),
            on_failure=options.get("on_failure", "abort"),
            location=self._document.place(path),
            included_from=self._included_from(path),
            path=path,
            known=known,
            written=written,
        )

    def _unknown(self, path: Location) -> Action:
        """Return an action in place of a step that cannot be interpreted."""
        location = self._document.place(path)
        none = Source("")
        return Action(UNKNOWN, none, (), {}, None, None, "abort", location, (), path, known=False)

    def _included_from(self, path: Location) -> tuple[str, ...]:
        """Return the locations of the ``include`` steps that a step comes from."""
        marks = [value.location for value in self._document.along(path)][1:]
        return tuple(str(a) for a, b in pairwise(marks) if a.line and a.source != b.source)

    def _rows(
        self, options: Mapping[str, Any], at: Location, groups: Groups, *, known: bool
    ) -> tuple[tuple[int, ...], bool]:
        """Return the rows of a step's ``agents``, and whether these are all of them."""
        given = options.get("agents", "all" if known else [])
        if "each" in at[:-1] and given and "agents" in options:
            self._report(
                (*at, "agents"),
                "a step of 'each' is for every agent by itself; name the agents in 'each'",
                "misplaced-key",
            )
            return (), False
        complete = True
        for i, name in enumerate([given] if isinstance(given, str) else given):
            if name not in groups and self._uncertain is not None:
                here = ("agents",) if isinstance(given, str) else ("agents", i)
                self._report((*at, *here), _no_agent(name, groups), "unknown-agent")
            complete = complete and name in groups and name not in (self._uncertain or ())
        return rows_of(given, groups), complete

    def _report(self, path: Location, message: str, code: str) -> None:
        self.problems.append(Problem(path, message, code))


def _short(location: str) -> str:
    """Return a location without folder and column.

    >>> _short("missions/patrol.yaml:5:3"), _short("--set mission=[]")
    ('patrol.yaml:5', '--set mission=[]')
    """
    found = re.fullmatch(r"(?:.*/)?([^/]+:\d+):\d+", location)
    return found[1] if found else location


def _no_agent(name: str, groups: Iterable[str]) -> str:
    several = re.split(r"[,\s]+", name.strip())
    if len(several) > 1 and {*groups} >= {*several}:
        hint = f"; write a list: agents: [{', '.join(several)}]"
    else:
        hint = suggestion(name, groups, "there are", MAX_LISTED)
    return f"no agent or group named {name!r}{hint}"
