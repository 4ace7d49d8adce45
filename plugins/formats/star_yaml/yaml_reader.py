"""Reads YAML as values with source locations.

Read as YAML 1.2, of which only what JSON can represent is accepted: no anchors, aliases, tags,
merge keys, dates or non-finite numbers.
"""

from __future__ import annotations

import math
import re
import sys
from codecs import BOM_UTF8
from contextlib import nullcontext
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from star_core import InputError
from star_core.formats import STDIN, Data, Mark, Value
from star_yaml.expressions import OPENING

if TYPE_CHECKING:
    from ruamel.yaml.nodes import Node

MAX_SIZE: Final = 1_000_000  # bytes: 10 s of reading; a mission of 1000 steps has 50 kB
DEEPEST: Final = 32  # levels of maps and lists: a step in four `parallel` is at level 11
_INTEGER: Final = re.compile(r"[-+]?(0|[1-9][0-9]{0,19})")
_FLOAT: Final = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")


def read_yaml(path: Path, *, text_keys: bool = False) -> Value:
    """Read a YAML file.

    Args:
        path: The file, or `STDIN`.
        text_keys: Accept keys that are numbers, and dates, as text.

    Raises:
        InputError: It cannot be read, is not YAML, or contains what is not accepted; lists every
            reason with its location.
    """
    try:
        with nullcontext(sys.stdin.buffer) if path == STDIN else path.open("rb") as stream:
            raw = stream.read(MAX_SIZE + 1).removeprefix(BOM_UTF8)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file", "file-not-found") from None
    except IsADirectoryError:
        if (path / "manifest.json").exists():
            message = f"{path}: is the record of a flight; `star view` and `star report` show it"
            raise InputError(message, "wrong-file") from None
        message = f"{path}: is a directory, expected a YAML file"
        raise InputError(message, "unreadable-file") from None
    except OSError as error:
        message = f"{path}: cannot be read: {error.strerror}"
        raise InputError(message, "unreadable-file") from error
    if len(raw) > MAX_SIZE:
        message = (
            f"the file has more than {MAX_SIZE / 1e6:g} MB; split it, or remove what is not read"
        )
        raise InputError(f"{Mark(str(path), 1, 1)}: {message}", "unreadable-file")
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        mark = _mark_at(raw[: error.start].decode("utf-8"), str(path))
        byte = f"byte 0x{raw[error.start]:02x} is not UTF-8; save the file as UTF-8"
        raise InputError(f"{mark}: {byte}", "unreadable-file") from None
    return parse(text, str(path), text_keys=text_keys)


def values(path: Path) -> Value:
    """Return the values of a file of any program; keys and dates are text."""
    return read_yaml(path, text_keys=True)


@lru_cache(maxsize=64)  # a study reads a mission for each of its conditions; values are immutable
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
    yaml = YAML(typ="safe", pure=True)
    yaml.composer.warn_double_anchors = False  # every anchor is refused below
    try:
        node = yaml.compose(text)
        value = None if node is None else reader.value(node)
    except MarkedYAMLError as error:
        from star_yaml.yaml_errors import explain

        line, column, message = explain(error, text)
        problem = f"{Mark(source, line, column)}: {message}"
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
            if isinstance(data, str) and data.startswith(OPENING):
                mark = self._mark_in(node)
            if data is None and not node.value:  # begins where the next token does
                mark = key or mark
        return Value(data, mark, key or mark)

    def _map(self, node: Node, depth: int) -> dict[str, Value]:
        from ruamel.yaml.nodes import ScalarNode

        entries: dict[str, Value] = {}
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
            elif name in entries:
                first = entries[name].key
                self._refuse(
                    mark,
                    f"key {name!r} is already there at line {first.line}, column {first.column};"
                    " keep one of the two",
                )
            entries[str(name)] = self.value(value, mark, depth + 1)
        return entries

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
            fault = "is not a plain, finite decimal number"
            self._refuse(mark, f"{_cut(text)} {fault}; write it as one, or in quotes if it is text")
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

    def _mark_in(self, node: Any) -> Mark:
        """Return the mark of an expression, in which its problems are located: after a quote."""
        mark = self._mark(node)
        if node.end_mark.line > node.start_mark.line:
            self._refuse(mark, "an expression stands on one line")
        return mark._replace(column=mark.column + (node.style in {"'", '"'}))

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
