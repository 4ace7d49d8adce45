"""Files whose top level is a map, with the locations of their values."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

from star_core import Problem
from star_core.formats import MAX_LISTED, Mark, Value, coded
from star_core.toolkit import suggestion

Location: TypeAlias = tuple[str | int, ...]
"""Keys and indices from the top of a document to a value."""


@dataclass(frozen=True)
class Document:
    """A file whose top level is a map.

    Attributes:
        root: The content.
        path: The file, as the user named it.
    """

    root: Value
    path: Path

    @cached_property
    def data(self) -> dict[str, Any]:
        """The content without locations."""
        data: dict[str, Any] = self.root.plain()
        return data

    def get(self, path: Location) -> Value | None:
        """Return the value at a path; None if there is none."""
        value: Value | None = self.root
        for name in path:
            value = value.child(name) if value is not None else None
        return value

    def mark(self, path: Location, *, key: bool = False) -> Mark:
        """Return the location of a value or, with `key`, of its key; or of the nearest parent."""
        *parents, value = self.along(path)
        return value.key if key and path and len(parents) == len(path) else value.location

    def along(self, path: Location) -> Iterator[Value]:
        """Yield the root and the values on a path from it, as far as there are any."""
        value = self.root
        yield value
        for name in path:
            if (child := value.child(name)) is None:
                return
            value = child
            yield value

    def location_text(self, path: Location, *, key: bool = False) -> str:
        """Return the location of a value: ``file:line:col``, or the assignment that set it."""
        return str(self.mark(path, key=key))

    def problem(
        self, path: Location, message: str, code: str = "invalid-option", *, key: bool = False
    ) -> str:
        """Return `message` after the location that it is about, with its code."""
        return coded(f"{self.mark(path, key=key)}: {message}", code)

    def located(self, problems: Iterable[Problem]) -> list[str]:
        """Return problems with their locations, in the order of the file."""
        return self.in_order(
            self.problem(
                problem.path, f"{'warning: ' * problem.warning}{problem.message}", problem.code
            )
            for problem in problems
        )

    def in_order(self, problems: Iterable[str]) -> list[str]:
        """Return each problem once: those of this file by line and column, then the others."""
        location = re.compile(rf"{re.escape(str(self.path))}:(\d+):(\d+): ")

        def order(problem: str) -> tuple[bool, int, int]:
            match = location.match(problem)
            return (False, int(match[1]), int(match[2])) if match else (True, 0, 0)

        return sorted(dict.fromkeys(problems), key=order)


def mapped(value: Value, change: Callable[[Value], Value]) -> Value:
    """Return a map or a list with each of its values changed; anything else as it is."""
    if isinstance(value.data, dict):
        return replace(value, data={key: change(item) for key, item in value.data.items()})
    if isinstance(value.data, list):
        return replace(value, data=[change(item) for item in value.data])
    return value


def unknown_name(path: Location, what: str, name: str, names: Iterable[str], code: str) -> Problem:
    """Return the problem of a name that nothing has."""
    hint = suggestion(name, names, "there are", MAX_LISTED)
    return Problem(path, f"no {what} named {name!r}{hint}", code)
