"""What stands in steps in the place of a value that a mission gives, and such values put in."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, Final

from star_core.errors import suggestion
from star_core.mission_file.located_document import Document
from star_core.mission_file.yaml_source import Location, Mark, Place

SIGN: Final = "$"
"""Begins a string that names a parameter."""

PATTERN: Final = r"^\$."
"""What the strings match that name a parameter."""

_COORDINATES: Final = 3
"""Values in a list whose places are told with the list's own: a point has no more."""


@dataclass(frozen=True, slots=True)
class Value:
    """What a parameter stands for, and where that is written.

    Attributes:
        data: The value.
        document: The file that it is in.
        at: Where in it.
    """

    data: Any
    document: Document
    at: Location


def is_parameter(value: Any) -> bool:
    """Whether a value of a step is a parameter's.

    >>> is_parameter("$height"), is_parameter("height"), is_parameter("$"), is_parameter(1)
    (True, False, False, False)
    """
    return isinstance(value, str) and re.match(PATTERN, value) is not None


def named(value: Any, at: Location) -> Iterator[Location]:
    """Yield where parameters stand in a value at a place, itself included."""
    if is_parameter(value):
        yield at
    pairs = enumerate(value) if isinstance(value, list) else ()
    for key, inner in value.items() if isinstance(value, dict) else pairs:
        yield from named(inner, (*at, key))


def filled(source: Document, values: Mapping[str, Value], problems: list[str]) -> Document:
    """Return a file of steps with values for its parameters.

    The place of a value is where it is written and then, after a colon, where it is used; so is
    that of a list with values in it. One that is itself a parameter is left as it stands.

    Args:
        source: The file, which fits its schema.
        values: By the name of the parameter.
        problems: What is wrong is added to these.
    """
    places = _Places(source)

    def fill(value: Any, at: Location) -> Any:
        if isinstance(value, dict):
            return {key: fill(inner, (*at, key)) for key, inner in value.items()}
        if isinstance(value, list):
            return [fill(inner, (*at, i)) for i, inner in enumerate(value)]
        if not is_parameter(value):
            return value
        name = value.removeprefix(SIGN)
        if name not in values:
            message = f"no parameter named {name!r}{suggestion(name, values)}"
            problems.append(source.problem(at, message))
        elif not is_parameter(values[name].data):
            places.put(at, name, values[name])
            return values[name].data
        return value

    steps = fill(source.data["mission"], ("mission",))
    return replace(source, data={**source.data, "mission": steps}, places=places)


class _Places(Mapping[Location, Place]):
    """The places in a file that values are put into; those of the values are made when asked for.

    A value that is used a thousand times would have as many, and each in it, too.
    """

    def __init__(self, source: Document) -> None:
        self._source = source
        self._values: dict[Location, Value] = {}
        self._used: dict[Location, str] = {}
        self._made: dict[Location, Place] = {}
        self._in_list: dict[Location, dict[str, Value]] = {}

    def put(self, at: Location, name: str, value: Value) -> None:
        """Take note that a value stands at a place."""
        self._values[at], self._used[at] = value, self._source.place(at)
        if isinstance(at[-1], int) and not isinstance(value.data, dict | list):
            self._in_list.setdefault(at[:-1], {})[name] = value

    def __getitem__(self, path: Location) -> Place:
        if path not in self._made:
            self._made[path] = self._make(path)
        return self._made[path]

    def __iter__(self) -> Iterator[Location]:
        """Yield the paths in the file itself."""
        return iter(self._source.places)

    def __len__(self) -> int:
        return len(self._source.places)

    def _make(self, path: Location) -> Place:
        for length in range(len(path), 0, -1):
            if (value := self._values.get(path[:length])) is not None:
                at, inner = path[:length], path[length:]
                return self._within(at, value, inner) if inner else self._whole(at, value)
        place = self._source.places[path]
        if path not in self._in_list:
            return place
        among = islice(self._in_list[path].values(), _COORDINATES)
        written = [value.document.place(value.at) for value in among]
        return place._replace(value=self._mark(path, ": ".join(dict.fromkeys(written))))

    def _whole(self, at: Location, value: Value) -> Place:
        """Return the place of a value that stands at one of the file."""
        used = self._mark(at, value.document.place(value.at))
        if isinstance(at[-1], int):
            return Place(used, used)
        key = self._source.places[at].key
        if isinstance(value.data, dict):  # of which what it lacks is told at the key
            key = key._replace(origin=used.origin)
        return Place(key, used)

    def _within(self, at: Location, value: Value, inner: Location) -> Place:
        """Return the place of what is in a value."""
        own = value.document.places[*value.at, *inner]
        used, told = self._used[at], value.document.at_mark(own.value)
        mark = Mark(own.value.line, own.value.column, f"{told}: {used}")
        if own.key == own.value:
            return Place(mark, mark)
        told = value.document.at_mark(own.key)
        return Place(Mark(own.key.line, own.key.column, f"{told}: {used}"), mark)

    def _mark(self, at: Location, written: str) -> Mark:
        """Return the mark of a place of the file that something written elsewhere stands at."""
        mark = self._source.mark(at)
        return Mark(mark.line, mark.column, f"{written}: {self._source.at_mark(mark)}")
