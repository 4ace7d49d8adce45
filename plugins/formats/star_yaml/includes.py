"""A mission as one document: names replaced by their values, and files put in that it names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from star_core import InputError, Registry
from star_core.formats import Value, coded, inside
from star_core.toolkit import suggestion
from star_yaml import schema
from star_yaml.document import Document, mapped
from star_yaml.schema import SIGN
from star_yaml.scopes import Findings, Scope, parameters


def resolved(
    document: Document, composed: Mapping[str, Any], registry: Registry
) -> tuple[Document, list[str], tuple[Path, ...]]:
    """Return a mission without names, with what its files contain, the problems and the files.

    Its ``let`` has the values of its names. Included steps become a ``repeat`` of one time, and an
    ``each`` with values by agent becomes one for each of them. What cannot be read remains as it
    is; and so does what is not an ``include`` or a ``file`` by the schema, which then reports it.

    Args:
        document: The mission.
        composed: Its schema.
        registry: Of the kinds of files.

    Raises:
        InputError: A name has no value, or an expression is wrong; lists what else is wrong by the
            schema.
    """
    findings = Findings()
    data = dict(document.root.map())
    let = data.pop("let", None)
    scope, values = Scope.of_mission(let, findings)
    data = {key: scope.fill(value) for key, value in data.items()}
    if let is not None:
        data["let"] = replace(let, data={**values})
    document = replace(document, root=replace(document.root, data=data))
    if findings.problems:
        problems = schema.problems(document, composed, parameters=True)
        raise InputError(document.in_order([*findings.problems, *problems]))
    files = _Files(document, registry, findings)
    if "cameras" in data:
        data["cameras"] = files.cameras(data["cameras"])
    for key in ("mission", "on"):
        if key in data:
            data[key] = files.steps(data[key], (document.path.resolve(),))
    document = replace(document, root=replace(document.root, data=data))
    return document, findings.problems, files.paths


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
    findings = Findings()
    scope = Scope.of_parameters(_defaults(document), findings)
    filled = scope.fill(document.root.need("mission"))
    root = replace(document.root, data={**document.root.map(), "mission": filled})
    if problems := [
        *findings.problems,
        *schema.problems(replace(document, root=root), composed, parameters=True),
    ]:
        raise InputError(problems)


class _Files:
    """Reads the files of a mission, each once, and puts their content into it."""

    def __init__(self, mission: Document, registry: Registry, findings: Findings) -> None:
        self._findings = findings
        self._registry = registry
        self._folder = mission.path.parent
        self._read: dict[tuple[str, Path], Document] = {}

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files that were read."""
        return tuple(document.path for document in self._read.values())

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
        return mapped(value, lambda item: self.steps(item, chain))

    def _included(self, step: Value, chain: tuple[Path, ...]) -> Value:
        include = step.need("include")
        source = self._file(include.need("file"), "steps", chain)
        if source is None:
            return step
        problems = self._findings.problems
        before = len(problems)
        arguments = include.map()["with"].map() if "with" in include.map() else {}
        values = self._values(include, arguments, source)
        scope = Scope.of_parameters(values, self._findings)
        steps = scope.fill(source.root.need("mission"))
        steps = self.steps(steps, (*chain, source.path.resolve()))
        if len(problems) > before:
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
                self._findings.report(value.key, why, "unknown-parameter")
        values |= arguments
        for name, value in values.items():
            if value.data is None or (name not in arguments and value.data == f"{SIGN}{name}"):
                at = arguments.get(name, include)
                why = f"needs a value for {name!r}: with: {{{name}: ...}}"
                self._findings.report(at.location, why, "missing-option")
                values[name] = replace(value, data=f"{SIGN}{name}")  # it is reported once
        return values

    def _file(self, name: Value, kind: str, chain: tuple[Path, ...] = ()) -> Document | None:
        """Return a file that the mission names; None, with a problem, if it cannot be used."""
        if not isinstance(name.data, str):
            return None
        try:
            path = inside(self._folder, name.data).resolve()
        except InputError as error:
            self._findings.report(name.location, str(error), error.code)
            return None
        if path in chain:
            between = ", ".join(f"{f.name!r}" for f in chain[chain.index(path) + 1 :])
            by_way = f", by way of {between}" * bool(between)
            self._findings.report(
                name.location, f"{name.data!r} includes itself{by_way}", "circular-include"
            )
            return None
        if (kind, path) not in self._read:
            try:
                document = schema.read_fitting(
                    self._folder / name.data, kind, schema.load(kind), self._registry
                )
            except InputError as error:
                self._findings.problems += error.problems
                return None
            if problems := _default_problems(document):
                self._findings.problems += problems
                return None
            self._read[kind, path] = document
        return self._read[kind, path]


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


def _defaults(document: Document) -> dict[str, Value]:
    """Return the parameters of a file of steps; those without a default stand for themselves."""
    written = document.root.map().get("parameters")
    return {
        name: replace(value, data=f"{SIGN}{name}") if value.data is None else value
        for name, value in (written.map().items() if written else ())
    }


def _default_problems(document: Document) -> list[str]:
    written = document.root.map().get("parameters")
    return [
        coded(f"{mark}: a default cannot refer to a parameter", "misplaced-key")
        for mark in (parameters(written) if written else ())
    ]
