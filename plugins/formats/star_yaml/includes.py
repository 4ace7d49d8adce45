"""Steps and cameras in files of their own, put into the mission that names them.

Values keep the locations at which they are written. A value of a parameter is located where it is
written and then, after a colon, where it is used.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from star_core import InputError, Registry
from star_core.formats import Document, Mark, Value, coded, inside
from star_core.toolkit import suggestion
from star_yaml import schema
from star_yaml.schema import SIGN, is_parameter

_COORDINATES: Final = 3
"""Values in a list whose locations are listed in the list's own: a point has no more."""


def with_files(document: Document, registry: Registry) -> tuple[Document, list[str]]:
    """Return a mission with its cameras' files and included steps put in, and the problems.

    Included steps become a ``repeat`` of one time. What cannot be read remains as it is; and so
    does what is not an ``include`` or a ``file`` by the schema, which then reports it.
    """
    files = _Files(document, registry)
    data = dict(document.root.map())
    if "cameras" in data:
        data["cameras"] = files.cameras(data["cameras"])
    if "mission" in data:
        data["mission"] = files.steps(data["mission"], (document.path.resolve(),))
    return replace(document, root=replace(document.root, data=data)), files.problems


def check_alone(document: Document, composed: Mapping[str, Any]) -> None:
    """Check a file of steps without a mission that includes it.

    A parameter has its default; nothing is known of one without. Files that it includes are not
    read, since they are in the mission's folder.

    Args:
        document: The file.
        composed: The schema of such files, with the installed verbs.

    Raises:
        InputError: Lists every problem.
    """
    if problems := schema.problems(document, schema.load("steps")) or _default_problems(document):
        raise InputError(problems)
    filled, problems = _filled(document.root.need("mission"), _defaults(document))
    root = replace(document.root, data={**document.root.map(), "mission": filled})
    if problems := [
        *problems,
        *schema.problems(replace(document, root=root), composed, parameters=True),
    ]:
        raise InputError(problems)


class _Files:
    """Reads the files of a mission, each once, and puts their content into it."""

    def __init__(self, mission: Document, registry: Registry) -> None:
        self.problems: list[str] = []
        self._registry = registry
        self._folder = mission.path.parent
        self._read: dict[tuple[str, Path], Document] = {}

    def cameras(self, cameras: Value) -> Value:
        """Return cameras with their files' content; keys of the mission itself take precedence."""
        if not isinstance(cameras.data, dict):
            return cameras
        return replace(
            cameras, data={n: self._camera(camera) for n, camera in cameras.data.items()}
        )

    def _camera(self, camera: Value) -> Value:
        options = camera.data
        if not isinstance(options, dict) or "file" not in options:
            return camera
        source = self._file(options["file"], "camera")
        if source is None:
            return camera
        read = {
            key: value for key, value in source.root.map().items() if key not in {"star", "name"}
        }
        return replace(
            camera, data=read | {k: value for k, value in options.items() if k != "file"}
        )

    def steps(self, value: Value, chain: tuple[Path, ...]) -> Value:
        """Return steps with every ``include`` in them replaced.

        Args:
            value: Steps, one step, or a value in one.
            chain: The files that include each other, the one with `value` last.
        """
        if _is_include(value):
            return self._included(value, chain)
        if isinstance(value.data, dict):
            return replace(
                value, data={k: self.steps(item, chain) for k, item in value.data.items()}
            )
        if isinstance(value.data, list):
            return replace(value, data=[self.steps(item, chain) for item in value.data])
        return value

    def _included(self, step: Value, chain: tuple[Path, ...]) -> Value:
        include = step.need("include")
        source = self._file(include.need("file"), "steps", chain)
        if source is None:
            return step
        before = len(self.problems)
        arguments = include.map()["with"].map() if "with" in include.map() else {}
        values = self._values(include, arguments, source)
        if len(chain) == 1:
            for mark in (mark for value in arguments.values() for mark in _parameters(value)):
                self._report(
                    mark, "parameters are for files that missions include", "misplaced-key"
                )
        steps, problems = _filled(source.root.need("mission"), values)
        self.problems += problems
        steps = self.steps(steps, (*chain, source.path.resolve()))
        if len(self.problems) > before:
            return step
        times = Value(1, step.mark, step.key)
        repeat = replace(step, data={"times": times, "steps": steps})
        return replace(step, data={"repeat": repeat})

    def _values(
        self, include: Value, arguments: Mapping[str, Value], source: Document
    ) -> dict[str, Value]:
        """Return the values of a file's parameters."""
        values = _defaults(source)
        for name, value in arguments.items():
            if name not in values:
                hint = suggestion(name, values)
                why = f"the file has no parameter {name!r}{hint}"
                self._report(value.key, why, "unknown-parameter")
        values |= arguments
        for name, value in values.items():
            if value.data is None or (name not in arguments and value.data == f"{SIGN}{name}"):
                at = arguments.get(name, include)
                why = f"needs a value for {name!r}: with: {{{name}: ...}}"
                self._report(at.location, why, "missing-option")
                values[name] = replace(value, data=f"{SIGN}{name}")  # it is reported once
        return values

    def _file(self, name: Value, kind: str, chain: tuple[Path, ...] = ()) -> Document | None:
        """Return a file that the mission names; None, with a problem, if it cannot be used."""
        if not isinstance(name.data, str):
            return None
        try:
            path = inside(self._folder, name.data).resolve()
        except InputError as error:
            self._report(name.location, str(error), error.code)
            return None
        if path in chain:
            between = ", ".join(f"{f.name!r}" for f in chain[chain.index(path) + 1 :])
            by_way = f", by way of {between}" * bool(between)
            self._report(
                name.location, f"{name.data!r} includes itself{by_way}", "circular-include"
            )
            return None
        if (kind, path) not in self._read:
            try:
                document = schema.read_fitting(
                    self._folder / name.data, kind, schema.load(kind), self._registry
                )
            except InputError as error:
                self.problems += error.problems
                return None
            if problems := _default_problems(document):
                self.problems += problems
                return None
            self._read[kind, path] = document
        return self._read[kind, path]

    def _report(self, mark: Mark, message: str, code: str) -> None:
        self.problems.append(coded(f"{mark}: {message}", code))


def _is_include(value: Value) -> bool:
    """Whether this is a step that includes a file."""
    if not isinstance(value.data, dict) or [*value.data] != ["include"]:
        return False
    include = value.need("include").plain()
    return (
        isinstance(include, dict)
        and isinstance(include.get("file"), str)
        and isinstance(include.get("with", {}), dict)
        and set(include) <= {"file", "with"}
    )


def _parameters(value: Value) -> Iterator[Mark]:
    """Yield the locations of parameters in a value, itself included."""
    if is_parameter(value.data):
        yield value.location
    for inner in value.children().values():
        yield from _parameters(inner)


def _defaults(document: Document) -> dict[str, Value]:
    """Return the parameters of a file of steps; those without a default stand for themselves."""
    parameters = document.root.map().get("parameters")
    return {
        name: replace(value, data=f"{SIGN}{name}") if value.data is None else value
        for name, value in (parameters.map().items() if parameters else ())
    }


def _default_problems(document: Document) -> list[str]:
    parameters = document.root.map().get("parameters")
    return [
        coded(f"{mark}: a default cannot refer to a parameter", "misplaced-key")
        for mark in (_parameters(parameters) if parameters else ())
    ]


def _filled(steps: Value, values: Mapping[str, Value]) -> tuple[Value, list[str]]:
    """Return steps with values for their parameters, and the problems.

    A parameter whose value is itself a parameter remains.
    """
    problems: list[str] = []

    def value_of(value: Value) -> Value | None:
        """Return the value that a parameter stands for, if this is one and it has one."""
        if not is_parameter(value.data):
            return None
        replacement = values.get(str(value.data).removeprefix(SIGN))
        return None if replacement is None or is_parameter(replacement.data) else replacement

    def fill(value: Value) -> Value:
        if isinstance(value.data, dict):
            return replace(value, data={key: fill(item) for key, item in value.data.items()})
        if isinstance(value.data, list):
            among = {
                item.data: replacement for item in value.data if (replacement := value_of(item))
            }
            written = [str(item.location) for item in among.values() if not item.children()]
            mark = value.location
            if written:
                text = ": ".join(dict.fromkeys(written[:_COORDINATES]))
                mark = mark._replace(source=f"{text}: {mark.source}")
            return Value(
                [fill(item) for item in value.data], mark if written else value.mark, value.key
            )
        if not is_parameter(value.data):
            return value
        if (replacement := value_of(value)) is None:
            name = str(value.data).removeprefix(SIGN)
            if name not in values:
                message = f"no parameter named {name!r}{suggestion(name, values)}"
                problems.append(coded(f"{value.location}: {message}", "unknown-parameter"))
            return value
        used = _used(replacement, value.location)
        in_list = value.key == value.mark
        return replace(
            used, key=used.mark if in_list or isinstance(replacement.data, dict) else value.key
        )

    return fill(steps), problems


def _used(value: Value, at: Mark) -> Value:
    """Return a value that is used elsewhere, with both locations."""
    data = value.data
    if isinstance(data, dict):
        data = {key: _used(item, at) for key, item in data.items()}
    elif isinstance(data, list):
        data = [_used(item, at) for item in data]
    return Value(data, value.location.used_at(at), value.key.used_at(at))
