"""The steps of a mission as a tree: built once, tolerant of mistakes, and traversed by all checks.

What a step lacks because of a mistake that its schema reports, is marked (`Action.known`), so that
the mistakes of all other steps are found in the same run.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any, Final, TypeAlias

from star_core import PluginError, Problem, Registry, Scene
from star_core.commands import SHARED, Source
from star_core.formats import JOIN, MAX_LISTED, Condition
from star_core.toolkit import (
    Action,
    Choice,
    Node,
    Parallel,
    Reaction,
    Repeat,
    fill_defaults,
    suggestion,
)
from star_yaml import conditions
from star_yaml.condition_kinds import AllOf
from star_yaml.document import Document, Location
from star_yaml.schema import UNKNOWN, Incomplete, Refused

Groups: TypeAlias = Mapping[str, tuple[int, ...]]
"""Rows by the name of an agent or a group, or ``all``."""

FIRST: Final = "first"
"""The value of the key ``agents`` of a reaction."""

ALWAYS: Final = AllOf(())
"""The condition of a step for one with a mistake."""


def rows_of(selection: str | list[str], groups: Groups) -> tuple[int, ...]:
    """Return the rows of a step's ``agents``, each once, in the order of the swarm."""
    names = [selection] if isinstance(selection, str) else selection
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
        self._members = {
            name: [scene.names[row] for row in rows] for name, rows in self._groups.items()
        }

    def build(self) -> tuple[Node, ...]:
        """Return the steps of the mission."""
        return self._steps(self._document.data.get("mission"), ("mission",), self._groups)

    def reactions(self) -> tuple[Reaction, ...]:
        """Return what the mission has ``on`` conditions."""
        written = self._document.data.get("on", [])
        reactions = []
        for i, reaction in enumerate(written if isinstance(written, list) else ()):
            at: Location = ("on", i)
            content = reaction if isinstance(reaction, dict) else {}
            steps, then = content.get("then"), (*at, "then")
            first = content.get("agents") == FIRST
            reactions.append(
                Reaction(
                    when=self._condition(content.get("when"), (*at, "when")) or ALWAYS,
                    steps=(self._for_each(steps, then, self._groups["all"]),)
                    if first
                    else self._steps(steps, then, self._groups),
                    location=self._document.location_text(at),
                    at=at,
                    first=first,
                )
            )
        return tuple(reactions)

    def _steps(self, items: Any, path: Location, groups: Groups) -> tuple[Node, ...]:
        if not isinstance(items, list) or path in self._refused:
            return ()
        return tuple(self._step(step, (*path, i), groups) for i, step in enumerate(items))

    def _step(self, step: Any, path: Location, groups: Groups) -> Node:
        legible = isinstance(step, dict) and path not in self._refused
        verbs = [verb for verb in step if (*path, verb) not in self._refused] if legible else []
        if len(verbs) != 1:
            return self._unknown(path)
        verb, content, at = verbs[0], step[verbs[0]], (*path, verbs[0])
        if verb == "parallel":
            branches = self._steps(content, at, groups)
            return Parallel(branches, at) if branches else self._unknown(path)
        if not isinstance(content, dict) or verb == "include":  # which could not be read
            return self._unknown(path)
        return self._with_options(verb, content, path, groups, alone=len(step) == 1)

    def _with_options(
        self, verb: str, content: Mapping[str, Any], path: Location, groups: Groups, *, alone: bool
    ) -> Node:
        """Return a step whose verb has options; `alone` if nothing stands beside the verb."""
        at = (*path, verb)
        if verb == "if":
            return self._choice(content, path, groups)
        options = {key: value for key, value in content.items() if key != "steps"}
        options = self._refused.without(options, at)
        if verb == "repeat":
            inner = self._steps(content.get("steps"), (*at, "steps"), groups)
            return Repeat(options.get("times", 1), inner, at) if inner else self._unknown(path)
        is_known = not isinstance(options, Incomplete) and alone
        rows, named = self._rows(options, at, groups, is_known=is_known)
        is_known = is_known and named
        if verb == "each":
            return self._for_each(content.get("steps"), (*at, "steps"), rows if is_known else ())
        action = self._action(verb, options, path, rows)
        if verb == JOIN and "agents" not in options and "each" not in path:
            self._report(at, f"{verb}: missing option 'agents'", "missing-option")
        return action if is_known else replace(action, known=False)

    def _for_each(self, steps: Any, path: Location, rows: tuple[int, ...]) -> Node:
        """Return the same steps for each of some agents."""
        at = path[:-1]
        sequences = [Repeat(1, self._steps(steps, path, {"all": (row,)}), at) for row in rows]
        if not sequences or not sequences[0].steps:
            return self._unknown(at[:-1])
        return Parallel(tuple(sequences), at, each=True)

    def _choice(self, content: Mapping[str, Any], path: Location, groups: Groups) -> Node:
        at = (*path, "if")
        steps = self._steps(content.get("then"), (*at, "then"), groups)
        if not steps:
            return self._unknown(path)
        return Choice(
            when=self._condition(content.get("when"), (*at, "when")) or ALWAYS,
            rows=groups["all"],
            steps=steps,
            otherwise=self._steps(content.get("else"), (*at, "else"), groups),
            location=self._document.location_text(path),
            at=at,
        )

    def _condition(self, written: Any, path: Location) -> Condition | None:
        """Return a condition; None if there is none, or something is wrong with it."""
        sound = self._refused.without(written, path)
        clear = isinstance(sound, dict) and not isinstance(sound, Incomplete)
        clear = clear and not isinstance(written, Incomplete)
        return conditions.parse(sound, self._members) if clear else None

    def _action(
        self, verb: str, options: Mapping[str, Any], path: Location, rows: tuple[int, ...]
    ) -> Action:
        is_known, source = True, Source("")
        values = {key: value for key, value in options.items() if key not in SHARED}
        try:
            task = self._registry.find("task", verb)
            source, values = task.source, fill_defaults(values, task.offer.options)
        except PluginError as error:
            self._report((*path, verb), error.message, error.code)
            is_known = False
        return Action(
            verb=verb,
            source=source,
            rows=rows,
            options=values,
            until=self._condition(options.get("until"), (*path, verb, "until")),
            timeout=options.get("timeout"),
            on_failure=options.get("on_failure", "abort"),
            location=self._document.location_text(path),
            included_from=self._included_from(path),
            path=path,
            known=is_known,
            written=options,
        )

    def _unknown(self, path: Location) -> Action:
        """Return an action in place of a step that cannot be interpreted."""
        location = self._document.location_text(path)
        none = Source("")
        return Action(UNKNOWN, none, (), {}, None, None, "abort", location, (), path, known=False)

    def _included_from(self, path: Location) -> tuple[str, ...]:
        """Return the locations of the ``include`` steps that a step comes from."""
        marks = [value.location for value in self._document.along(path)][1:]
        return tuple(str(a) for a, b in pairwise(marks) if a.line and a.source != b.source)

    def _rows(
        self, options: Mapping[str, Any], at: Location, groups: Groups, *, is_known: bool
    ) -> tuple[tuple[int, ...], bool]:
        """Return the rows of a step's ``agents``, and whether these are all of them."""
        selection = options.get("agents", "all" if is_known else [])
        if "each" in at[:-1] and selection and "agents" in options:
            self._report(
                (*at, "agents"),
                "a step of 'each' is for every agent by itself; name the agents in 'each'",
                "misplaced-key",
            )
            return (), False
        complete = True
        for i, name in enumerate([selection] if isinstance(selection, str) else selection):
            if name not in groups and self._uncertain is not None:
                item_path = ("agents",) if isinstance(selection, str) else ("agents", i)
                self._report((*at, *item_path), _no_agent(name, groups), "unknown-agent")
            complete = complete and name in groups and name not in (self._uncertain or ())
        return rows_of(selection, groups), complete

    def _report(self, path: Location, message: str, code: str) -> None:
        self.problems.append(Problem(path, message, code))


def _no_agent(name: str, groups: Iterable[str]) -> str:
    several = re.split(r"[,\s]+", name.strip())
    if len(several) > 1 and {*groups} >= {*several}:
        hint = f"; write a list: agents: [{', '.join(several)}]"
    else:
        hint = suggestion(name, groups, "there are", MAX_LISTED)
    return f"no agent or group named {name!r}{hint}"
