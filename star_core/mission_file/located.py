"""YAML files as values with source locations.

Read as YAML 1.2, of which only what JSON can represent is accepted: no anchors, aliases, tags,
merge keys, dates or non-finite numbers.
"""

from __future__ import annotations

import math
import re
from codecs import BOM_UTF8
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

from star_core.contracts import Problem
from star_core.errors import InputError, coded, suggestion
from star_core.mission_file.shipped import named
from star_core.plugin_schema import PARTS

if TYPE_CHECKING:
    from ruamel.yaml.error import MarkedYAMLError
    from ruamel.yaml.nodes import Node

Location: TypeAlias = tuple[str | int, ...]
"""Keys and indices from the top of a document to a value."""
Data: TypeAlias = "dict[str, Value] | list[Value] | str | float | bool | None"
Kind: TypeAlias = Literal["mission", "steps", "world", "camera", "study"]

_OWN: dict[Kind, set[str]] = {  # keys that only these files have
    "mission": {"world", "swarm", *PARTS},
    "study": {"missions", "factors", "measures"},
    "world": {"fence", "obstacles", "landmarks", "targets"},
    "camera": {"width", "height", "matrix", "distortion", "position", "exposure", "readout"}
    | {"roll_deg", "pitch_deg", "yaw_deg"},
}
DEEPEST = 32  # levels of maps and lists: a step in four `parallel` is at level 11
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]{0,19})")
_FLOAT = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")


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
    def place(self) -> str:
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
            value = value.children().get(name) if value is not None else None
        return value

    def mark(self, path: Location, *, key: bool = False) -> Mark:
        """Return the location of a value or, with `key`, of its key; or of the nearest parent."""
        for length in range(len(path), 0, -1):
            if (value := self.get(path[:length])) is not None:
                return value.key if key and length == len(path) else value.location
        return self.root.location

    def place(self, path: Location, *, key: bool = False) -> str:
        """Return the location of a value: ``file:line:col``, or the assignment that set it."""
        return str(self.mark(path, key=key))

    def problem(
        self, path: Location, message: str, code: str = "invalid-option", *, key: bool = False
    ) -> str:
        """Return `message` after the location that it is about, with its code."""
        return coded(f"{self.mark(path, key=key)}: {message}", code)

    def located(self, problems: Iterable[Problem]) -> list[str]:
        """Return problems with their locations, in the order of the file."""
        return self.in_order((self.mark(one.path), one.message, one.code) for one in problems)

    def in_order(self, problems: Iterable[tuple[Mark, str, str]]) -> list[str]:
        """Return each problem once: those of this file by line and column, then the others."""
        ordered = sorted(
            dict.fromkeys(problems), key=lambda one: (one[0].source != str(self.path), *one[0][1:])
        )
        return list(dict.fromkeys(coded(f"{mark}: {text}", code) for mark, text, code in ordered))


def kind_of(data: Mapping[str, Any]) -> Kind:
    """Return what a file is meant to be, by its keys; a mission if it could be anything.

    Steps for missions to include have ``parameters``, however misspelt, or no key of a mission but
    ``mission`` itself.
    """
    keys = set(data)
    if keys & _OWN["mission"]:
        return "mission"
    more = keys - {"star", "name", "mission"}
    if any(suggestion(key, ["parameters"]) for key in more) or ("mission" in keys and not more):
        return "steps"
    if "mission" in keys:
        return "mission"
    if keys & _OWN["study"]:
        return "study"
    others: tuple[Kind, ...] = ("world", "camera")
    for kind in others:
        if any(suggestion(key, _OWN[kind]) for key in more):
            return kind
    return "mission"


def read(path: Path) -> Document:
    """Read a YAML file whose top level is a map.

    Args:
        path: The file, or the name of one that comes with STAR, such as ``first_flight``.

    Raises:
        InputError: It cannot be read, is not YAML, or contains what is not accepted; lists every
            reason with its location.
    """
    path = named(path)
    root = read_yaml(path)
    if not isinstance(root.data, dict):
        raise root.wrong(
            f"the file holds {shown(root.data)}, expected a map such as `star: 1`", "wrong-type"
        )
    return Document(root, path)


def read_yaml(path: Path, *, text_keys: bool = False) -> Value:
    """Read a YAML file.

    Args:
        path: The file.
        text_keys: Accept keys that are numbers, and dates, as text.

    Raises:
        InputError: It cannot be read, is not YAML, or contains what is not accepted; lists every
            reason with its location.
    """
    try:
        raw = path.read_bytes().removeprefix(BOM_UTF8)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file", "file-not-found") from None
    except IsADirectoryError:
        message = f"{path}: is a directory, expected a YAML file"
        raise InputError(message, "unreadable-file") from None
    except OSError as error:
        message = f"{path}: cannot be read: {error.strerror}"
        raise InputError(message, "unreadable-file") from error
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        mark = _mark_at(raw[: error.start].decode("utf-8"), str(path))
        byte = f"byte 0x{raw[error.start]:02x} is not UTF-8; save the file as UTF-8"
        raise InputError(f"{mark}: {byte}", "unreadable-file") from None
    return parse(text, str(path), text_keys=text_keys)


def parse(text: str, source: str, *, text_keys: bool = False) -> Value:
    """Parse YAML.

    Example:
        >>> value = parse("limits: {speed: fast}", "m.yaml")
        >>> value.plain()
        {'limits': {'speed': 'fast'}}
        >>> str(value.need("limits").need("speed").mark)
        'm.yaml:1:17'

    Raises:
        InputError: It is not YAML, or contains what is not accepted; lists every reason.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError
    from ruamel.yaml.reader import ReaderError

    reader = _Reader(source, text_keys=text_keys)
    if text.startswith("%"):  # another version would give words another meaning
        message = "a line that begins with '%' is refused; remove it"
        raise InputError(f"{Mark(source, 1, 1)}: {message}", "invalid-yaml")
    try:
        node = YAML(typ="safe", pure=True).compose(text)
        value = None if node is None else reader.value(node)
    except MarkedYAMLError as error:
        problem = _syntax_problem(error, source)
    except ReaderError as error:
        character = f"character {chr(error.character)!r} is refused; it cannot be printed"
        problem = f"{_mark_at(text[: error.position], source)}: {character}"
    except RecursionError:
        problem = f"{Mark(source, 1, 1)}: the maps and lists are nested too deeply"
    except (ValueError, OverflowError, AssertionError) as error:  # of an absurd escape or directive
        problem = f"{Mark(source, 1, 1)}: not YAML: {error}"
    else:
        if value is None:
            message = "the file is empty, expected a map such as `star: 1`"
            raise InputError(f"{Mark(source, 1, 1)}: {message}", "invalid-yaml")
        if reader.problems:
            ordered = sorted(dict.fromkeys(reader.problems))
            raise InputError([f"{mark}: {what}" for mark, what in ordered], "invalid-yaml")
        return value
    raise InputError(problem, "invalid-yaml")


def shown(data: Any) -> str:
    """Return a value in a message; of a long one the beginning."""
    if isinstance(data, dict | list):
        return "a map" if isinstance(data, dict) else "a list"
    longest = 40
    text = "empty" if data is None else repr(data)
    return text if len(text) <= longest else text[:longest] + "..."


class _Reader:
    """Converts the nodes of one text; notes what is refused."""

    def __init__(self, source: str, *, text_keys: bool) -> None:
        self.problems: list[tuple[Mark, str]] = []
        self._source = source
        self._text_keys = text_keys

    def value(self, node: Node, key: Mark | None = None, depth: int = 1) -> Value:
        from ruamel.yaml.nodes import MappingNode, ScalarNode, SequenceNode

        mark = self._mark(node)
        if node.anchor is not None:  # nor is it descended into: aliases refer to the same node
            self._refuse(mark, f"anchor '&{node.anchor}' is refused; write the value out")
            return Value(None, mark, key or mark)
        data: Data
        if depth > DEEPEST and not isinstance(node, ScalarNode):
            self._refuse(mark, f"nested deeper than {DEEPEST} levels")
            data = None
        elif isinstance(node, MappingNode):
            self._check_tag(node, mark, "map")
            data = self._map(node, depth)
        elif isinstance(node, SequenceNode):
            self._check_tag(node, mark, "seq")
            data = [self.value(item, depth=depth + 1) for item in node.value]
        else:
            data = self._scalar(node, mark)
            if data is None and not node.value:  # begins where the next token does
                mark = key or mark
        return Value(data, mark, key or mark)

    def _map(self, node: Node, depth: int) -> dict[str, Value]:
        from ruamel.yaml.nodes import ScalarNode

        found: dict[str, Value] = {}
        for inner, value in node.value:
            mark = self._mark(inner)
            if not isinstance(inner, ScalarNode):
                self._refuse(mark, "a map or a list cannot be a key")
                continue
            name = str(inner.value) if self._text_keys else self.value(inner).data
            if _kind(inner) == "merge":
                self._refuse(mark, "merge key '<<' is refused; write the keys out")
            elif not isinstance(name, str):
                hint = "; a decimal has a point" if isinstance(name, int | float) else ""
                quoted = f"put it in quotes: '{inner.value}'"
                self._refuse(mark, f"key {name!r} is not a string; {quoted}{hint}")
            elif name in found:
                first = found[name].key
                self._refuse(
                    mark,
                    f"key {name!r} is already there at line {first.line}, column {first.column};"
                    " keep one of the two",
                )
            found[str(name)] = self.value(value, mark, depth + 1)
        return found

    def _scalar(self, node: Any, mark: Mark) -> str | float | bool | None:
        text, kind = str(node.value), _kind(node)
        if kind == "null":
            return None
        if kind == "bool":
            return text.lower() == "true"
        if kind in {"int", "float"}:
            if _INTEGER.fullmatch(text):
                return int(text)
            if _FLOAT.fullmatch(text) and math.isfinite(float(text)):
                return float(text)
            wanted = "is not a plain, finite decimal number"
            self._refuse(
                mark, f"{_cut(text)} {wanted}; write it as one, or in quotes if it is text"
            )
        elif kind == "timestamp" and not self._text_keys:
            self._refuse(mark, f"{_cut(text)} is a date; put it in quotes")
        elif kind not in {"timestamp", "merge"}:
            self._check_tag(node, mark, "str")
        # JSON escapes a character beyond U+FFFF as a pair of surrogates
        return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")

    def _check_tag(self, node: Node, mark: Mark, expected: str) -> None:
        if _kind(node) != expected:
            tag = str(node.tag)
            self._refuse(mark, f"tag {tag!r} is refused; a mission is data and never code")

    def _mark(self, node: Node) -> Mark:
        return Mark(self._source, node.start_mark.line + 1, node.start_mark.column + 1)

    def _refuse(self, mark: Mark, message: str) -> None:
        self.problems.append((mark, message))


def _kind(node: Node) -> str:
    """Return the last word of a node's tag: map, seq, str, int, ..."""
    prefix, _, kind = str(node.tag).rpartition(":")
    return kind if prefix == "tag:yaml.org,2002" else str(node.tag)


def _mark_at(before: str, source: str) -> Mark:
    """Return the mark of the character after a text."""
    lines = re.split(r"\r\n?|\n", before)
    return Mark(source, len(lines), len(lines[-1]) + 1)


def _cut(text: str) -> str:
    longest = 24
    return text if len(text) <= longest else text[:longest] + "..."


def _syntax_problem(error: MarkedYAMLError, source: str) -> str:
    """Return where a text stops being YAML, and why, in one line."""
    at = error.problem_mark or error.context_mark
    mark = Mark(source, at.line + 1, at.column + 1)
    problem, context = str(error.problem or ""), str(error.context or "")
    if "'\\t'" in problem:
        return f"{mark}: a tab stands here; YAML is indented with spaces"
    if "mapping values are not allowed" in problem:
        return f"{mark}: a ':' cannot stand here; check the indentation, or put the text in quotes"
    if "another document" in problem:
        return f"{mark}: a second document begins here, expected one; remove the '---'"
    since = ""
    if context and error.context_mark is not None:
        begun = error.context_mark
        since = f" ({context} that begins at line {begun.line + 1}, column {begun.column + 1})"
    return f"{mark}: not YAML: " + " ".join(f"{problem}{since}".split())
