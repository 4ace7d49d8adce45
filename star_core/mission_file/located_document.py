"""Reads a YAML file and keeps the place of everything in it, so that every error can name one.

Values can be set over a document from the command line; their place is then the assignment.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from star_core.contracts import Problem
from star_core.errors import InputError, coded, suggestion
from star_core.mission_file.yaml_source import DEEPEST, START, Location, Mark, Place, mark_at, parse

LARGEST = 2**20  # bytes: far more than a mission, and read in seconds
PARTS = ("transport", "localizer", "planner", "avoider")  # a bare name stands for {use: name}
Kind: TypeAlias = Literal["mission", "steps", "world", "camera"]
_OWN: dict[Kind, set[str]] = {  # what only they have
    "mission": {"world", "swarm", *PARTS},
    "world": {"fence", "obstacles", "landmarks", "targets"},
    "camera": {"width", "height", "matrix", "distortion", "position", "exposure", "readout"}
    | {"roll_deg", "pitch_deg", "yaw_deg"},
}


@dataclass(frozen=True, slots=True)
class Document:
    """Plain data, and where it was written.

    Attributes:
        data: What was read: maps, lists, strings, numbers, truth values and None.
        path: The file, as the user called it.
        places: Of every key and value, by its path of keys and indices.
    """

    data: dict[str, Any]
    path: Path
    places: Mapping[Location, Place]

    def place(self, path: Location, *, key: bool = False) -> str:
        """Return where a value stands, or with `key` its key: ``file:line:col``, from 1.

        A value that begins on a line below its key's is placed at the key.

        Where nothing stands at `path`, the place is that of the nearest parent that is there. The
        place of what was set on the command line is the assignment: ``--set avoider.radius=-1``.
        """
        return self.at_mark(self.mark(path, key=key))

    def at_mark(self, mark: Mark) -> str:
        """Return a point of the file, or what stands for it, as it is told."""
        return mark.origin or f"{self.path}:{mark.line}:{mark.column}"

    def problem(
        self, path: Location, message: str, code: str = "invalid-option", *, key: bool = False
    ) -> str:
        """Return `message` after the location that it is about, with its code."""
        return coded(f"{self.place(path, key=key)}: {message}", code)

    def told(self, faults: Iterable[tuple[Location, str] | Problem]) -> list[str]:
        """Return problems with their locations, in the order of the file."""
        problems = [Problem(*fault) for fault in faults]
        located = {(self.mark(one.path), one.message): self.problem(*one) for one in problems}
        return [located[key] for key in sorted(located, key=lambda key: (key[0].origin != "", key))]

    def mark(self, path: Location, *, key: bool = False) -> Mark:
        """Return where a value or its key stands; what was set sorts behind what was read."""
        for length in range(len(path), -1, -1):
            if (place := self.places.get(path[:length])) is not None:
                below = place.key.line < place.value.line
                return place.key if below or (key and length == len(path)) else place.value
        return START


def kind_of(document: Document) -> Kind:
    """Return what a file is meant to be, by its keys; what could be anything is a mission.

    Steps for missions to include have ``parameters``, however misspelt, or no key of a mission but
    ``mission`` itself.
    """
    keys = set(document.data)
    if keys & _OWN["mission"]:
        return "mission"
    more = keys - {"star", "name", "mission"}
    if any(suggestion(key, ["parameters"]) for key in more) or ("mission" in keys and not more):
        return "steps"
    if "mission" in keys:
        return "mission"
    others: tuple[Kind, ...] = ("world", "camera")
    for kind in others:
        if any(suggestion(key, _OWN[kind]) for key in more):
            return kind
    return "mission"


def read(path: Path) -> Document:
    """Read a YAML file whose top level is a map.

    Raises:
        InputError: The file cannot be read, is not YAML, or holds what a mission may not:
            everything found is listed, each with its place.
    """
    text = _text(path)
    parsed = parse(text)
    problems = [f"{path}:{mark.line}:{mark.column}: {what}" for mark, what in parsed.problems]
    if not problems and not isinstance(parsed.data, dict):
        mark = START if parsed.empty else parsed.places[()].value
        found = "the file is empty" if parsed.empty else f"the file holds {_what(parsed.data)}"
        problems = [f"{path}:{mark.line}:{mark.column}: {found}, expected a map such as `star: 1`"]
    if problems:
        raise InputError(problems)
    return Document(parsed.data, path, parsed.places)


def override(document: Document, assignments: Sequence[str]) -> Document:
    """Return a document with values set, each given as ``path=value``.

    A path is keys and list indices from 0, joined by dots; a value is YAML: ``avoider.radius=0.3``,
    ``mission.0.takeoff.height=1``, ``swarm.cf1.start=[0, 0, 0]``. Maps that are missing on the way
    are made. Where a plugin is given as a bare name, setting an option of it first makes that
    ``{use: name}``.

    Raises:
        InputError: An assignment has no ``=``, no value or a value that is not YAML, or its path
            leads nowhere. Each one that cannot be followed is listed.
    """
    problems: list[str] = []
    for number, assignment in enumerate(assignments, start=1):
        try:
            shown = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in assignment)
            document = _set(document, assignment, Mark(number, 1, f"--set {shown}"))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return document


def _text(path: Path) -> str:
    """Read a file as UTF-8, with or without a byte order mark.

    Raises:
        InputError: It cannot be read, is too large, or is not UTF-8.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(LARGEST + 1)
    except FileNotFoundError:
        raise InputError([f"{path}: no such file"], "file-not-found") from None
    except IsADirectoryError:
        raise InputError(
            [f"{path}: is a directory, expected a YAML file"], "unreadable-file"
        ) from None
    except OSError as error:
        raise InputError(
            [f"{path}: cannot be read: {error.strerror}"], "unreadable-file"
        ) from error
    if len(raw) > LARGEST:
        raise InputError([f"{path}: is larger than {LARGEST} bytes, the most that is read"])
    try:
        return raw.decode("utf-8").removeprefix("\N{BYTE ORDER MARK}")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8").removeprefix("\N{BYTE ORDER MARK}")
        mark = mark_at(before, len(before))
        byte = f"byte 0x{raw[error.start]:02x} is not UTF-8; save the file as UTF-8"
        raise InputError([f"{path}:{mark.line}:{mark.column}: {byte}"]) from None


def _set(document: Document, assignment: str, mark: Mark) -> Document:
    """Follow one assignment.

    Raises:
        InputError: It cannot be followed.
    """
    written, equals, text = assignment.partition("=")
    if not equals:
        raise _refused(mark, "has no '=', expected path=value such as avoider.radius=0.3")
    names = written.strip().split(".")
    if not all(names) or len(names) > DEEPEST:
        raise _refused(mark, "expected keys joined by dots before the '='")
    data, places = copy.deepcopy(document.data), dict(document.places)
    into: Any = data
    at: Location = ()
    for name in names[:-1]:
        at = (*at, _step(into, at, name, mark))
        if isinstance(into, dict) and at[-1] not in into:
            into[at[-1]] = {}
            places[at] = Place(mark, mark)
        elif len(at) == 1 and name in PARTS and isinstance(into[name], str):
            into[name] = {"use": into[name]}
            places[*at, "use"] = places[at]
        into = into[at[-1]]
    at = (*at, _step(into, at, names[-1], mark))
    parsed = parse(text, base=at)
    if parsed.problems:
        raise InputError([f"{mark.origin}: {what}" for _, what in parsed.problems])
    if parsed.empty or not text.strip():
        raise _refused(mark, "has no value after the '='")
    into[at[-1]] = parsed.data
    places = {path: place for path, place in places.items() if path[: len(at)] != at}
    places |= dict.fromkeys(parsed.places, Place(mark, mark))
    return Document(data, document.path, places)


def _step(into: Any, at: Location, name: str, mark: Mark) -> str | int:
    """Return the key or index that `name` means in what stands at path `at`.

    Raises:
        InputError: Nothing can stand there.
    """
    if isinstance(into, dict):
        return name
    here = ".".join(str(part) for part in at)
    if not isinstance(into, list):
        raise _refused(mark, f"'{here}' is {_what(into)} and has no {name!r}")
    if not (name.isascii() and name.isdecimal()):
        raise _refused(mark, f"'{here}' is a list: expected an index in place of {name!r}")
    if len(name) > len(str(len(into))) or int(name) >= len(into):
        last = f"the last is {len(into) - 1}" if into else "it is empty"
        raise _refused(mark, f"'{here}' has no item {name}; {last}")
    return int(name)


def _refused(mark: Mark, message: str) -> InputError:
    return InputError([f"{mark.origin}: {message}"])


def _what(value: Any) -> str:
    if isinstance(value, list):
        return "a list"
    longest = 40
    shown = repr(value)
    return shown if len(shown) <= longest else shown[:longest] + "..."
