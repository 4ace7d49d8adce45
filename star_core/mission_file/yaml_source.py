"""Turns YAML text into plain data and remembers where every key and value stands.

Read as YAML 1.2, of which only what JSON can hold is taken: no anchors, aliases, tags, merge keys,
dates or non-finite numbers. The text is read event by event in one flat loop, so that neither deep
nesting nor an alias that multiplies itself can cost more than the text is long.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import StringIO
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from star_core.errors import InputError
from star_core.mission_file.yaml_scalars import ODD, odd, plain, quoted

if TYPE_CHECKING:
    from ruamel.yaml.error import MarkedYAMLError
    from ruamel.yaml.events import Event, NodeEvent

Location: TypeAlias = tuple[str | int, ...]

DEEPEST = 32  # levels of maps and lists: a step inside four `parallel` is at level 11
MOST_VALUES = 50_000  # a swarm of 1000 agents with their starts has some 6000
MOST_PROBLEMS = 100  # in one file; more than anybody reads


class Mark(NamedTuple):
    """A point of a text, from 1; or the assignment on the command line that stands for it."""

    line: int
    column: int
    origin: str = ""


START = Mark(1, 1)


class Place(NamedTuple):
    """Where a value stands, and the key it belongs to; both are the same in a list."""

    key: Mark
    value: Mark


@dataclass(frozen=True, slots=True)
class Parsed:
    """What a text holds.

    Attributes:
        data: Plain data; of no use if there are problems.
        places: Of every key and value, by its path of keys and indices.
        problems: What was refused, in the order of the text.
        empty: Whether there is nothing but comments.
    """

    data: Any
    places: Mapping[Location, Place]
    problems: tuple[tuple[Mark, str], ...]
    empty: bool


def parse(text: str, base: Location = ()) -> Parsed:
    """Read `text` as what stands at path `base` of a document.

    Example:
        >>> parsed = parse("limits: {speed: fast}")
        >>> parsed.data
        {'limits': {'speed': 'fast'}}
        >>> parsed.places["limits", "speed"]
        Place(key=Mark(line=1, column=10, origin=''), value=Mark(line=1, column=17, origin=''))
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError

    if found := ODD.search(text):
        problem = (mark_at(text, found.start()), odd(found.group()))
        return Parsed(None, {}, (problem,), empty=False)
    builder = _Builder(base)
    try:
        for event in YAML(typ="safe", pure=True).parse(StringIO(text)):
            if not builder.take(event):
                break
    except MarkedYAMLError as error:
        builder.problems.append(_syntax_problem(error))
    except (ValueError, OverflowError, AssertionError) as error:  # of an absurd escape or directive
        builder.problems.append((builder.newest, f"not YAML hereafter: {error}"))
    problems = tuple(sorted(builder.problems, key=lambda problem: problem[0]))
    return Parsed(builder.data, builder.places, problems, builder.empty)


def mark_at(text: str, offset: int) -> Mark:
    r"""Return the place of the character at `offset`.

    >>> mark_at("a: 1\r\nb: 2", 9)
    Mark(line=2, column=4, origin='')
    """
    breaks = list(re.finditer(r"\r\n?|\n", text[:offset]))
    return Mark(len(breaks) + 1, offset - (breaks[-1].end() if breaks else 0) + 1)


@dataclass(slots=True)
class _Open:
    """A map or a list whose end has not come yet."""

    value: dict[str, Any] | list[Any]
    location: Location
    is_key: bool = False
    key: str | None = None  # of a map: whose value comes next
    key_mark: Mark = START


@dataclass(slots=True)
class _Builder:
    """Takes the events of one document."""

    base: Location
    data: Any = None
    empty: bool = True
    places: dict[Location, Place] = field(default_factory=dict)
    problems: list[tuple[Mark, str]] = field(default_factory=list)
    newest: Mark = START
    stack: list[_Open] = field(default_factory=list)
    documents: int = 0

    def take(self, event: Event) -> bool:
        """Take one event, and say whether it is of any use to take more."""
        from ruamel.yaml import events

        mark = self.newest = _mark(event.start_mark)
        if len(self.places) > MOST_VALUES:
            self._refuse(mark, f"more than {MOST_VALUES} values")
            return False
        match event:
            case events.DocumentStartEvent():
                return self._begin(event, mark)
            case events.AliasEvent():
                self._refuse(mark, f"alias '*{event.anchor}' is refused; write the value out")
                self._put(f"*{event.anchor}", mark, as_key=None)
            case events.ScalarEvent():
                self._check(event, mark)
                value = self._scalar(event, mark)
                if value is None and not event.value:  # its own mark is at whatever comes next
                    mark = self._key_mark() or mark
                self._put(value, mark, as_key=event.value)
            case events.MappingStartEvent() | events.SequenceStartEvent():
                self._check(event, mark)
                new: dict[str, Any] | list[Any]
                new = {} if isinstance(event, events.MappingStartEvent) else []
                return self._open(new, mark)
            case events.MappingEndEvent() | events.SequenceEndEvent():
                closed = self.stack.pop()
                if closed.is_key:
                    self.stack[-1].key, self.stack[-1].key_mark = "?", mark
        return len(self.problems) < MOST_PROBLEMS

    def _begin(self, event: Any, mark: Mark) -> bool:
        self.documents += 1
        if self.documents > 1:
            self._refuse(mark, "a second document begins here, expected one; remove the '---'")
            return False
        if event.version not in (None, (1, 2)):
            self._refuse(mark, "a %YAML line for another version than 1.2 is refused; remove it")
        return True

    def _check(self, event: NodeEvent, mark: Mark) -> None:
        if event.anchor is not None:
            self._refuse(mark, f"anchor '&{event.anchor}' is refused; write the value out")
        if (tag := getattr(event, "tag", None)) is not None:
            self._refuse(mark, f"tag {str(tag)!r} is refused; a mission is data and never code")

    def _open(self, new: dict[str, Any] | list[Any], mark: Mark) -> bool:
        """Begin a map or a list."""
        if len(self.base) + len(self.stack) >= DEEPEST:
            self._refuse(mark, f"nested deeper than {DEEPEST} levels")
            return False
        is_key = bool(self.stack) and self._wants_key(self.stack[-1])
        location = self._put(new, mark, as_key=None)
        self.stack.append(_Open(new, location, is_key=is_key))
        return True

    def _put(self, value: Any, mark: Mark, as_key: str | None) -> Location:
        """Put a value where it belongs and return its path; or keep it as the next key."""
        if not self.stack:
            self.data, self.empty = value, False
            self.places[self.base] = Place(mark, mark)
            return self.base
        into = self.stack[-1]
        if self._wants_key(into):
            into.key, into.key_mark = self._key(into, value, mark, as_key), mark
            return into.location
        if isinstance(into.value, list):
            location = (*into.location, len(into.value))
            self.places[location] = Place(mark, mark)
            into.value.append(value)
            return location
        key, into.key = into.key or "", None
        location = (*into.location, key)
        self.places[location] = Place(into.key_mark, mark)
        into.value[key] = value
        return location

    def _wants_key(self, into: _Open) -> bool:
        return isinstance(into.value, dict) and into.key is None

    def _key_mark(self) -> Mark | None:
        """Return where the key is whose value comes next."""
        into = self.stack[-1] if self.stack else None
        return into.key_mark if into and into.key is not None else None

    def _key(self, into: _Open, value: Any, mark: Mark, written: str | None) -> str:
        """Return a key, having noted what is wrong with it."""
        if not isinstance(value, str):
            if written is None:
                self._refuse(mark, "a map or a list cannot be a key")
            else:
                hint = "; a decimal has a point" if isinstance(value, int | float) else ""
                self._refuse(
                    mark, f"key {value!r} is not a string; put it in quotes: '{written}'{hint}"
                )
            return str(value)
        if value in into.value:
            first = self.places[(*into.location, value)].key
            self._refuse(
                mark,
                f"key {value!r} is already there at line {first.line}, column {first.column};"
                " keep one of the two",
            )
        return value

    def _scalar(self, event: Any, mark: Mark) -> Any:
        """Return a scalar, having noted what is wrong with it."""
        is_plain = event.tag is None and event.implicit[0]
        if is_plain and event.value == "<<" and self.stack and self._wants_key(self.stack[-1]):
            self._refuse(mark, "merge key '<<' is refused; write the keys out")
            return event.value
        try:
            return plain(event.value) if is_plain else quoted(event.value)
        except InputError as error:
            self._refuse(mark, str(error))
            return event.value

    def _refuse(self, mark: Mark, message: str) -> None:
        self.problems.append((mark, message))


def _mark(mark: Any) -> Mark:
    return Mark(mark.line + 1, mark.column + 1)


def _syntax_problem(error: MarkedYAMLError) -> tuple[Mark, str]:
    """Return where a text stops being YAML, and why, in one line."""
    mark = _mark(error.problem_mark or error.context_mark)
    problem, context = str(error.problem or ""), str(error.context or "")
    if "'\\t'" in problem:
        return mark, "a tab stands here; YAML is indented with spaces"
    if "mapping values are not allowed" in problem:
        return mark, "a ':' cannot stand here; check the indentation, or put the text in quotes"
    since = ""
    if context and error.context_mark is not None:
        begun = _mark(error.context_mark)
        since = f" ({context} that begins at line {begun.line}, column {begun.column})"
    return mark, "not YAML: " + " ".join(f"{problem}{since}".split())
