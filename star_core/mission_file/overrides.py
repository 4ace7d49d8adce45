"""Values that are set over a document from the command line (``--set``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from star_core.errors import InputError
from star_core.mission_file.located import Document, Mark, Value, shown
from star_core.mission_file.yaml_reader import parse
from star_core.plugin_support.option_schema import PARTS


def override(document: Document, assignments: Sequence[str]) -> Document:
    """Return a document with values set, each given as ``path=value``.

    A path is keys and list indices from 0, joined by dots; a value is YAML: ``avoider.radius=0.3``,
    ``mission.0.takeoff.height=1``, ``swarm.cf1.start=[0, 0, 0]``. Missing maps are made. Where a
    plugin is given as a bare name, setting an option of it first makes that ``{use: name}``.

    Raises:
        InputError: An assignment has no ``=``, no value or a value that is not YAML, or its path
            does not exist; lists every one.
    """
    problems: list[str] = []
    root = document.root
    for assignment in assignments:
        printable = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in assignment)
        try:
            root = _assigned(root, assignment, Mark(f"--set {printable}"))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return replace(document, root=root)


def _assigned(root: Value, assignment: str, mark: Mark) -> Value:
    written, equals, text = assignment.partition("=")
    if not equals:
        raise _error(mark, "has no '=', expected path=value such as avoider.radius=0.3")
    names = written.strip().split(".")
    if not all(names):
        raise _error(mark, "expected keys joined by dots before the '='")
    if not text.strip() or text.strip().startswith("#"):
        raise _error(mark, "has no value after the '='")
    try:
        value = parse(text, "").moved(mark)
    except InputError as error:
        whys = [problem.split(": ", 1)[1] for problem in error.problems]
        raise InputError([f"{mark}: {why}" for why in whys]) from None
    return _put(root, names, [], value)


def _put(into: Value, names: Sequence[str], at: Sequence[str], value: Value) -> Value:
    """Return `into`, which is at path `at`, with `value` at the path `names` below it."""
    if not names:
        return value
    name, *rest = names
    if isinstance(into.data, str) and len(at) == 1 and at[0] in PARTS:
        into = replace(into, data={"use": into})
    if isinstance(into.data, dict):
        inner = into.data.get(name, Value({}, value.mark, value.mark))
        return replace(into, data={**into.data, name: _put(inner, rest, [*at, name], value)})
    here = ".".join(at)
    if not isinstance(into.data, list):
        raise _error(value.mark, f"'{here}' is {shown(into.data)} and has no {name!r}")
    if not (name.isascii() and name.isdecimal()):
        raise _error(value.mark, f"'{here}' is a list: expected an index in place of {name!r}")
    items = dict(enumerate(into.data))
    index = int(name) if len(name) <= len(str(len(items))) else len(items)
    if index not in items:
        last = f"the last is {len(items) - 1}" if items else "it is empty"
        raise _error(value.mark, f"'{here}' has no item {name}; {last}")
    items[index] = _put(items[index], rest, [*at, name], value)
    return replace(into, data=list(items.values()))


def _error(mark: Mark, message: str) -> InputError:
    return InputError(f"{mark}: {message}", "invalid-assignment")
