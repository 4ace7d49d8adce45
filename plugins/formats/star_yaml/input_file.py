"""The files that commands are given: found, read, of the kind that is needed, with values set."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

from star_core import InputError, Registry
from star_core.commands import PIPELINE_KINDS
from star_core.formats import STDIN, Mark, Value, printable, shown
from star_core.toolkit import suggestion
from star_yaml.document import Document
from star_yaml.yaml_reader import MAX_SIZE, parse, read_yaml

_KEY: Final = re.compile(r"^([A-Za-z_]\w*)[ \t]*:", re.MULTILINE)  # at the top of a map in blocks
_CLEAR: Final = 3  # keys by which a file without `star: 1` is recognized
_NEEDED: Final = ("world", "swarm", *PIPELINE_KINDS)  # what steps lack to be a mission


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


@cache
def shipped_files() -> dict[str, Path]:
    """Return the files by name: ``first_flight``, ``studies/avoiders``, ``worlds/lab_4x4``."""
    packaged = Path(__file__).with_name("missions")
    folder = packaged if packaged.is_dir() else Path(__file__).parents[3] / "missions"
    files = [*sorted(folder.glob("*.yaml")), *sorted(folder.glob("*/*.yaml"))]
    return {file.relative_to(folder).with_suffix("").as_posix(): file for file in files}


def named(path: Path) -> Path:
    """Return the path of a file that a user names: `path`, or else the shipped file of that name.

    Raises:
        InputError: There is neither.
    """
    if path == STDIN or path.exists() or path.is_absolute():
        return path
    files = shipped_files()
    if path.as_posix() in files:
        return files[path.as_posix()]
    if path.suffix and path.stem not in files:  # reading it states the reason
        return path
    if path.suffix:
        text = f"{path}: no such file; {path.stem!r}, without a suffix, comes with STAR"
        raise InputError(text, "file-not-found")
    hint = suggestion(path, files) or "; `star missions` lists those that come with STAR"
    raise InputError(f"{path}: no file and no mission of that name{hint}", "unknown-mission")


def missions() -> dict[str, tuple[Path, str]]:
    """Return the shipped files and their descriptions by name."""
    return {name: (file, file_description(file)) for name, file in shipped_files().items()}


def file_description(file: Path) -> str:
    """Return the first sentence of the comment at the top of a file."""
    lines = file.read_text(encoding="utf-8").splitlines()
    comments = [line[1:].strip() for line in takewhile(lambda line: line.startswith("#"), lines)]
    text = " ".join(line for line in comments if not line.startswith("yaml-language-server"))
    return text.partition(". ")[0].removesuffix(".")


def kind_of(data: Mapping[str, Any], registry: Registry) -> str:
    """Return the name of what a file is meant to be, by its keys; a mission if it may be that.

    It is of the kind with most of its keys or, of several, the one that most of the unknown keys
    resemble.
    """
    keys = set(data) - {"star", "name"}
    if keys == {"mission"}:
        return "steps"
    kinds = dict(registry.offers()["file_kind"])
    kinds = {"mission": kinds.pop("mission"), **kinds}
    counts = {name: len(keys.intersection(kind.keys)) for name, kind in kinds.items()}
    likely = [name for name in kinds if counts[name] == max(counts.values())]
    if len(likely) == 1:
        return likely[0]
    unknown = keys.difference(*(kind.keys for kind in kinds.values()))
    return max(
        likely, key=lambda name: sum(bool(suggestion(key, kinds[name].keys)) for key in unknown)
    )


def resembles(path: Path, registry: Registry) -> bool:
    """Return whether a file is clearly meant for STAR, valid or not, by the keys at its margin.

    It has the key `star`, or several keys of a kind that ``star check`` accepts.
    """
    if path.suffix not in {".yaml", ".yml"} or not path.is_file():
        return False
    try:
        with path.open("rb") as stream:
            text = stream.read(MAX_SIZE).decode("utf-8-sig", "replace")
    except OSError:
        return True  # reading it states the reason
    keys = {*_KEY.findall(text)}
    kind = registry.find("file_kind", kind_of(dict.fromkeys(keys), registry)).offer
    accepted = kind.check is not None or kind.name in {"mission", "steps"}
    return accepted and ("star" in keys or len(keys.intersection(kind.keys)) >= _CLEAR)


def require_kind(document: Document, expected: str, registry: Registry) -> None:
    """Require that a file is not clearly of another kind.

    Raises:
        InputError: It is; states which.
    """
    data, kinds = document.data, registry.offers()["file_kind"]
    name = kind_of(data, registry)
    kind = kinds[name]
    clear = name == "steps" or not {*data}.isdisjoint({*kind.keys} - {"mission"})
    if name == expected or (expected != "mission" and not clear):
        return
    hint = kind.hints.get(expected, "")
    if (name, expected) == ("mission", "world") and data.get("world") != document.path.name:
        hint = f"its world is {data.get('world')!r}"
    hint = f"; {hint}" if hint else ""
    hint += lacking(document) if (name, expected) == ("steps", "mission") else ""
    text = f"this is {kind.noun}, expected {kinds[expected].noun}{hint}"
    raise document.root.wrong(text, "wrong-file")


def lacking(document: Document) -> str:
    """Return what a file of steps without parameters lacks if it is meant to be a mission."""
    missing = [key for key in _NEEDED if key not in document.data]
    lacks = f"; as a mission it lacks {', '.join(missing)}"
    return "" if "parameters" in document.data else lacks


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
        try:
            root = _assigned(
                root, assignment, Mark("--set " + printable(assignment).replace("\n", "\\n"))
            )
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
    if isinstance(into.data, str) and len(at) == 1 and at[0] in PIPELINE_KINDS:
        into = replace(into, data={"use": into})
    if isinstance(into.data, dict):
        if at == ["let"] and name not in into.data:
            hint = suggestion(name, into.data, "there are")
            raise _error(value.mark, f"nothing in 'let' is named {name!r}{hint}")
        inner = into.data.get(name, Value({}, value.mark, value.mark))
        return replace(into, data={**into.data, name: _put(inner, rest, [*at, name], value)})
    position = ".".join(at)
    if not isinstance(into.data, list):
        raise _error(value.mark, f"'{position}' is {shown(into.data)} and has no {name!r}")
    if not (name.isascii() and name.isdecimal()):
        raise _error(value.mark, f"'{position}' is a list: expected an index in place of {name!r}")
    items = dict(enumerate(into.data))
    index = int(name) if len(name) <= len(str(len(items))) else len(items)
    if index not in items:
        last = f"the last is {len(items) - 1}" if items else "it is empty"
        raise _error(value.mark, f"'{position}' has no item {name}; {last}")
    items[index] = _put(items[index], rest, [*at, name], value)
    return replace(into, data=list(items.values()))


def _error(mark: Mark, message: str) -> InputError:
    return InputError(f"{mark}: {message}", "invalid-assignment")
