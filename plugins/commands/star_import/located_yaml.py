"""Reads YAML of other formats into values with source locations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from star_core import InputError

if TYPE_CHECKING:
    from ruamel.yaml.nodes import Node

LARGEST: Final = 2**20  # bytes, file size limit: far more than the files of a swarm
DEEPEST: Final = 32  # levels of maps and lists

Data: TypeAlias = "str | float | bool | Mapping[str, Value] | list[Value] | None"


@dataclass(frozen=True, slots=True)
class Value:
    """A value and its source location.

    Attributes:
        data: Text, a number, a boolean, None, a map or a list of values.
        place: ``file:line:col``, from 1.
    """

    data: Data
    place: str

    def wrong(self, message: str) -> InputError:
        """Return an error about this value."""
        return InputError([f"{self.place}: {message}"])

    def map(self) -> Mapping[str, Value]:
        """Return it as a map, empty if there is no value.

        Raises:
            InputError: It is not a map.
        """
        if self.data is None:
            return {}
        if not isinstance(self.data, Mapping):
            raise self.wrong(f"{_show(self.data)}, expected a map")
        return self.data

    def list(self) -> Sequence[Value]:
        """Return it as a list, empty if there is no value.

        Raises:
            InputError: It is not a list.
        """
        if self.data is None:
            return ()
        if not isinstance(self.data, list):
            raise self.wrong(f"{_show(self.data)}, expected a list")
        return self.data

    def text(self) -> str:
        """Return it as text, numbers in Python's notation.

        Raises:
            InputError: It is not text.
        """
        if isinstance(self.data, bool) or not isinstance(self.data, str | int | float):
            raise self.wrong(f"{_show(self.data)}, expected text")
        return str(self.data)

    def number(self) -> float:
        """Return it as a finite number.

        Raises:
            InputError: It is not a finite number.
        """
        if isinstance(self.data, bool) or not isinstance(self.data, int | float):
            raise self.wrong(f"{_show(self.data)}, expected a number")
        return float(self.data)

    def flag(self) -> bool:
        """Return it as a boolean.

        Raises:
            InputError: It is not a boolean.
        """
        if not isinstance(self.data, bool):
            raise self.wrong(f"{_show(self.data)}, expected true or false")
        return self.data

    def numbers(self) -> tuple[float, ...]:
        """Return it as a list of finite numbers.

        Raises:
            InputError: It is not a list of finite numbers.
        """
        return tuple(value.number() for value in self.list())

    def need(self, key: str) -> Value:
        """Return the value of a key.

        Raises:
            InputError: It is not a map, or has no such key.
        """
        if key not in self.map():
            raise self.wrong(f"has no {key!r}")
        return self.map()[key]


def read(path: Path) -> Value:
    """Read a YAML file.

    Raises:
        InputError: It cannot be read, is not YAML, or contains an alias, a tag or a duplicate key.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError
    from ruamel.yaml.events import AliasEvent

    text = _text(path)
    try:
        for event in YAML(typ="safe", pure=True).parse(text):
            if isinstance(event, AliasEvent):
                raise _at(path, event, f"alias '*{event.anchor}' is not supported; copy the value")
        node = YAML(typ="safe", pure=True).compose(text)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise InputError([f"{path}:{line}: is not YAML: {error.problem}"]) from error
    except (ValueError, RecursionError) as error:
        raise InputError([f"{path}: is not readable YAML: {error}"]) from error
    if node is None:
        raise InputError([f"{path}: is empty"])
    return _value(path, node, 0)


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            raw = file.read(LARGEST + 1)
    except OSError as error:
        raise InputError([f"{path}: cannot be read: {error.strerror}"]) from error
    if len(raw) > LARGEST:
        raise InputError([f"{path}: is larger than the limit of {LARGEST} bytes"])
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError([f"{path}: is not UTF-8: {error}"]) from error


def _value(path: Path, node: Node, depth: int) -> Value:
    """Convert a ruamel node and its content to values."""
    from ruamel.yaml.nodes import MappingNode, ScalarNode, SequenceNode

    place = f"{path}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"
    if depth > DEEPEST:
        raise InputError([f"{place}: nested deeper than {DEEPEST} levels"])
    if isinstance(node, ScalarNode):
        return Value(_scalar(path, node), place)
    if isinstance(node, SequenceNode):
        return Value([_value(path, item, depth + 1) for item in node.value], place)
    if not isinstance(node, MappingNode):
        raise _at(path, node, "expected a map, a list or a value")
    found: dict[str, Value] = {}
    for key, value in node.value:
        if not isinstance(key, ScalarNode):
            raise _at(path, key, "expected a text key")
        if key.value in found:
            raise _at(path, key, f"key {key.value!r} is repeated")
        found[key.value] = _value(path, value, depth + 1)
    return Value(found, place)


def _scalar(path: Path, node: Any) -> str | float | bool | None:
    kind = str(node.tag).rpartition(":")[2]
    if kind == "null":
        return None
    if kind == "bool":
        return str(node.value).lower() == "true"
    if kind not in {"int", "float"}:
        return str(node.value)
    try:
        value = int(node.value) if kind == "int" else float(node.value)
    except ValueError as error:
        raise _at(path, node, f"{node.value!r} is not a plain decimal number") from error
    if not math.isfinite(value):
        raise _at(path, node, f"{node.value!r} is not a finite number")
    return value


def _at(path: Path, what: Any, message: str) -> InputError:
    mark = what.start_mark
    return InputError([f"{path}:{mark.line + 1}:{mark.column + 1}: {message}"])


def _show(data: object) -> str:
    if isinstance(data, Mapping):
        return "is a map"
    if isinstance(data, list):
        return "is a list"
    return "is left empty" if data is None else f"is {data!r}"
