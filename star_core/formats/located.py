"""Values of files with their source locations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from star_core.errors import InputError

Data: TypeAlias = "dict[str, Value] | list[Value] | str | float | bool | None"


class Mark(NamedTuple):
    """A point of a file, from 1; or, with line 0, an assignment on the command line."""

    source: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}" if self.line else self.source

    def used_at(self, used: Mark) -> Mark:
        """Return the mark of something that is written here and used elsewhere."""
        return used._replace(source=f"{self}: {used.source}")


@dataclass(frozen=True, slots=True)
class Value:
    """A value and its source location.

    Attributes:
        data: Text, a number, a boolean, None, a map or a list of values.
        mark: Where the value begins.
        key: Where its key begins; that of the value in a list.
    """

    data: Data
    mark: Mark
    key: Mark

    @property
    def begins_at(self) -> str:
        """Where the value begins: ``file:line:col``, from 1."""
        return str(self.mark)

    @property
    def location(self) -> Mark:
        """The value's mark, or its key's if the value begins on a line below it."""
        return self.key if self.key.line < self.mark.line else self.mark

    def children(self) -> Mapping[Any, Value]:
        """Return the values of a map by key, of a list by index; empty for anything else."""
        if isinstance(self.data, dict):
            return self.data
        return dict(enumerate(self.data)) if isinstance(self.data, list) else {}

    def child(self, name: str | int) -> Value | None:
        """Return the value of a key or at an index; None if there is none."""
        return self.children().get(name)

    def plain(self) -> Any:
        """Return the value without locations."""
        if isinstance(self.data, dict):
            return {key: value.plain() for key, value in self.data.items()}
        return [value.plain() for value in self.data] if isinstance(self.data, list) else self.data

    def moved(self, mark: Mark) -> Value:
        """Return the same value, with everything in it located at `mark`."""
        data = self.data
        if isinstance(data, dict):
            data = {key: value.moved(mark) for key, value in data.items()}
        elif isinstance(data, list):
            data = [value.moved(mark) for value in data]
        return Value(data, mark, mark)

    def wrong(self, message: str, code: str = "invalid-input") -> InputError:
        """Return an error about this value."""
        return InputError(f"{self.mark}: {message}", code)

    # The following raise an `InputError` if the value is of another type.

    def map(self) -> Mapping[str, Value]:
        """Return it as a map, empty if there is no value."""
        if not isinstance(self.data, dict | None):
            raise self._mistyped("a map")
        return self.data or {}

    def list(self) -> list[Value]:
        """Return it as a list, empty if there is no value."""
        if not isinstance(self.data, list | None):
            raise self._mistyped("a list")
        return self.data or []

    def text(self) -> str:
        """Return it as text, numbers in Python's notation."""
        if isinstance(self.data, bool) or not isinstance(self.data, str | int | float):
            raise self._mistyped("text")
        return str(self.data)

    def number(self) -> float:
        """Return it as a finite number."""
        if isinstance(self.data, bool) or not isinstance(self.data, int | float):
            raise self._mistyped("a number")
        return float(self.data)

    def numbers(self) -> tuple[float, ...]:
        """Return it as a list of finite numbers."""
        return tuple(value.number() for value in self.list())

    def flag(self) -> bool:
        """Return it as a boolean."""
        if not isinstance(self.data, bool):
            raise self._mistyped("true or false")
        return self.data

    def _mistyped(self, expected: str) -> InputError:
        return self.wrong(f"is {shown(self.data)}, expected {expected}", "wrong-type")

    def need(self, key: str) -> Value:
        """Return the value of a key, which must be there."""
        if key not in self.map():
            raise self.wrong(f"has no {key!r}", "missing-option")
        return self.map()[key]


def shown(data: Any) -> str:
    """Return a value in a message; of a long one the beginning."""
    if isinstance(data, dict | list):
        return "a map" if isinstance(data, dict) else "a list"
    longest = 40
    text = "empty" if data is None else repr(data)
    return text if len(text) <= longest else text[:longest] + "..."
