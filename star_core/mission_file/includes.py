"""Steps that stand in a file of their own: read, furnished with values, put where they belong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from star_core.errors import InputError, suggestion
from star_core.mission_file import schema
from star_core.mission_file.include_parameters import SIGN, Value, filled, named
from star_core.mission_file.located_document import Document
from star_core.mission_file.yaml_source import DEEPEST, MOST_VALUES, Location, Mark, Place
from star_core.scene import inside

LONGEST: Final = 8
"""Files that include each other in a row, at most."""


def expanded(document: Document) -> Document:
    """Return a mission with every ``include`` replaced by the steps of the file that it names.

    The steps stand there as a ``repeat`` of one time; their places are those in their own file. A
    string that is ``$`` and the name of one of the file's parameters is replaced by its value,
    whose place is told first. What is no ``include`` as the schema has it stays, for the schema to
    complain of.

    Raises:
        InputError: A file cannot be read, is none of steps, includes itself, or is given values
            that it does not take or lacks one; every reason found is listed.
    """
    way = _Way(document.path.parent, (document.path.resolve(),))
    data, places, problems = _node(document.data, (), document, way)
    if problems:
        raise InputError(list(dict.fromkeys(problems)))
    return replace(document, data=data, places=places)


def lacking(document: Document) -> str:
    """Say what a file of steps without parameters lacks if it is meant to be a mission."""
    if "parameters" in document.data:
        return ""
    needed = [key for key in schema.load("mission")["required"] if key not in document.data]
    return f"; as a mission it lacks {', '.join(needed)}"


def check_alone(document: Document, composed: Mapping[str, Any]) -> None:
    """Hold a file of steps to its schema, as far as that goes without a mission that includes it.

    A parameter has the value that it has if a mission does not give one. What it includes itself is
    not looked for: that is in the mission's folder.

    Args:
        document: The file.
        composed: The schema of such files, with the verbs that there are.

    Raises:
        InputError: Something is wrong with it; every reason found is listed.
    """
    if found := schema.problems(document, schema.load("steps")) or _default_faults(document):
        raise InputError(found)
    given = {
        name: f"{SIGN}{name}" if value is None else value
        for name, value in document.data.get("parameters", {}).items()
    }
    values = _values(document, ("parameters",), given)
    furnished = filled(document, values, found)
    _node(furnished.data, (), furnished, _Way(document.path.parent, (), opens=False))
    if found := [*found, *schema.problems(furnished, composed, parameters=True)]:
        raise InputError(found)


Answer = tuple[Any, dict[Location, Place], list[str]]


@dataclass(slots=True)
class _Tally:
    """How many values there are so far, in all files, and those files as read."""

    values: int = 0
    files: dict[Path, Document] = field(default_factory=dict)

    def file(self, path: Path, name: Path) -> Document:
        """Return the file of steps at `path`, which the user calls `name`.

        Raises:
            InputError: It cannot be read or is none.
        """
        if path not in self.files:
            document = schema.read_as(name, "steps")
            if found := _default_faults(document):
                raise InputError(found)
            self.files[path] = document
        return self.files[path]


@dataclass(frozen=True, slots=True)
class _Way:
    """How one came to a file.

    Attributes:
        folder: The mission's.
        files: Those that include each other, this one last.
        level: How deep in the mission the file's steps stand.
        opens: Whether what is included is put in.
        tally: Of the whole mission.
    """

    folder: Path
    files: tuple[Path, ...]
    level: int = 0
    opens: bool = True
    tally: _Tally = field(default_factory=_Tally)

    def through(self, path: Path, level: int) -> _Way:
        """Return the way on to a file that stands so much deeper."""
        return replace(self, files=(*self.files, path), level=self.level + level)

    def count(self, at: Location) -> str:
        """Count one more value, and say if that is more, or deeper, than what one file may have."""
        self.tally.values += 1
        if self.tally.values > MOST_VALUES:
            return f"more than {MOST_VALUES} values, together with the files that are included"
        if self.level + len(at) > DEEPEST:
            return f"nested deeper than {DEEPEST} levels, together with the files that include it"
        return ""


def _node(value: Any, at: Location, document: Document, way: _Way) -> Answer:
    """Return what stands at a place of a document, with the places in it, by their paths.

    Raises:
        InputError: The mission grows larger than one file may be.
    """
    if why := way.count(at):
        raise InputError([document.problem(at, why)])
    place = document.places.get(at)
    places = {} if place is None else {at: place}
    problems: list[str] = []
    if way.opens and _is_include(value):
        return _included(value["include"], at, document, way)
    data: Any = value
    if isinstance(value, dict | list):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        made = {key: _node(inner, (*at, key), document, way) for key, inner in pairs}
        for _, own, faults in made.values():
            places |= own
            problems += faults
        inner = {key: one for key, (one, _, _) in made.items()}
        data = inner if isinstance(value, dict) else list(inner.values())
    return data, places, problems


def _is_include(value: Any) -> bool:
    """Whether this is a step that includes a file."""
    given = value.get("include") if isinstance(value, dict) and len(value) == 1 else None
    return (
        isinstance(given, dict)
        and isinstance(given.get("file"), str)
        and isinstance(given.get("with", {}), dict)
        and set(given) <= {"file", "with"}
    )


def _included(given: Mapping[str, Any], at: Location, document: Document, way: _Way) -> Answer:
    here = (*at, "include", "file")
    try:
        path = inside(way.folder, given["file"])
    except InputError as error:
        return None, {}, [document.problem(here, str(error))]
    if circle := _circle(path, way):
        return None, {}, [document.problem(here, f"{given['file']!r} {circle}")]
    try:
        source = way.tally.file(path, way.folder / given["file"])
    except InputError as error:
        return None, {}, list(error.problems)
    parameters = source.data.get("parameters", {})
    defaults = _values(source, ("parameters",), parameters)
    values = defaults | _values(document, (*at, "include", "with"), given.get("with", {}))
    problems = [
        document.problem((*at, "include", "with", name), message, key=True)
        for name, message in _misfits(given.get("with", {}), parameters)
    ]
    for name, value in values.items():
        if value.data is None:
            place = (*at, "include", *(("with", name) if name in given.get("with", {}) else ()))
            why = f"needs a value for {name!r}: with: {{{name}: ...}}"
            problems.append(document.problem(place, why))
            values[name] = replace(value, data=f"{SIGN}{name}")  # it is told once
    if len(way.files) == 1:  # the mission
        problems += [
            document.problem(place, "parameters are for files that missions include")
            for place in named(given.get("with"), (*at, "include", "with"))
        ]
    steps = filled(source, values, problems)
    on = way.through(path.resolve(), len(at) + 1)  # (..., "repeat", "steps") for ("mission",)
    data, places, faults = _node(steps.data["mission"], ("mission",), steps, on)
    where = (*at, "repeat", "steps")
    step = document.places[at] if at in document.places else Place(Mark(1, 1), Mark(1, 1))
    moved = {at: step, (*at, "repeat"): step, (*at, "repeat", "times"): step}
    moved |= {(*where, *path[1:]): _of_file(place, steps.path) for path, place in places.items()}
    return {"repeat": {"times": 1, "steps": data}}, moved, problems + faults


def _values(document: Document, at: Location, given: Mapping[str, Any]) -> dict[str, Value]:
    return {name: Value(value, document, (*at, name)) for name, value in given.items()}


def _default_faults(document: Document) -> list[str]:
    """Say where the defaults in a file of steps refer to parameters themselves."""
    return [
        document.problem(place, "a default cannot refer to a parameter")
        for place in named(document.data.get("parameters"), ("parameters",))
    ]


def _circle(path: Path, way: _Way) -> str:
    """Say that files include each other without end, if they do."""
    if (file := path.resolve()) in way.files:
        between = ", ".join(f"{f.name!r}" for f in way.files[way.files.index(file) + 1 :])
        return "includes itself" + f", by way of {between}" * bool(between)
    if len(way.files) > LONGEST:
        return f"is included by more than {LONGEST} files in a row"
    return ""


def _misfits(given: Mapping[str, Any], known: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name in given:
        if name not in known:
            yield name, f"the file has no parameter {name!r}{suggestion(name, known)}"


def _of_file(place: Place, path: Path) -> Place:
    """A place that says which file it is in."""
    return Place(
        *(
            mark
            if mark.origin
            else Mark(mark.line, mark.column, f"{path}:{mark.line}:{mark.column}")
            for mark in (place.key, place.value)
        )
    )
