"""Checks a file of any kind."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from star_core import InputError, Mission, PluginError, Problem, Registry
from star_core.commands import guarded
from star_core.formats import FileKindSpec, SourceFile
from star_core.toolkit import actions
from star_yaml import schema
from star_yaml.checks.cameras import camera_problems
from star_yaml.document import Document
from star_yaml.includes import check_alone
from star_yaml.input_file import kind_of, lacking, override, read
from star_yaml.mission_loader import checked
from star_yaml.world_loader import world


def check_file(
    path: Path, registry: Registry, assignments: Sequence[str] = ()
) -> tuple[str, Sequence[str]]:
    """Return, in one line, what a file is good for, and warnings.

    Args:
        path: Of the file.
        registry: Registry of the plugins.
        assignments: ``path=value`` each, to be set in it first, but not values that only missions
            have in another kind of file.

    Raises:
        InputError: Something is wrong with it.
    """
    document = read(path)
    kind = registry.find("file_kind", kind_of(document.data, registry))
    if assignments and kind.offer.name != "mission":
        assignments = _applicable(assignments, kind.offer, registry)
    if kind.offer.name == "steps":
        return f"{path}: {_steps(override(document, assignments), registry)}", ()
    if kind.offer.check is None:
        return _mission(path, document, assignments, registry)
    document = override(document, assignments)
    return f"{path}: {guarded('file kind', kind, _checked, document, kind.offer, registry)}", ()


def _applicable(
    assignments: Sequence[str], kind: FileKindSpec, registry: Registry
) -> Sequence[str]:
    """Return the assignments without those of keys that missions have, and this kind does not."""
    keys, own = (
        set() if offer.schema is None else {*offer.schema(registry)["properties"]}
        for offer in (registry.find("file_kind", "mission").offer, kind)
    )
    return [text for text in assignments if re.split(r"[.=]", text)[0] not in keys - own]


def _checked(document: Document, kind: FileKindSpec, registry: Registry) -> str:
    """Check a file of a kind that is neither a mission nor steps."""
    if kind.schema is not None and (problems := schema.problems(document, kind.schema(registry))):
        raise InputError(problems)
    return kind.check(document, registry) if kind.check is not None else kind.noun


def _mission(
    path: Path, document: Document, assignments: Sequence[str], registry: Registry
) -> tuple[str, Sequence[str]]:
    mission = checked(document, registry, assignments)
    by_plugin = registry.manager.hook.star_check(mission=mission, registry=registry)
    problems: list[Problem] = [problem for listed in by_plugin for problem in listed]
    if errors := [problem for problem in problems if not problem.warning]:
        raise InputError(mission.file.located(errors))
    agents = len(mission.scene.agents)
    many = "agents" if agents > 1 else "agent"
    expected = "".join(f"; {text}" for text in dict.fromkeys(_expected(mission, registry)))
    text = f"{path}: {mission.name!r} can be flown, with {agents} {many}{expected}"
    return text, (*mission.warnings, *mission.file.located(problems))


def _expected(mission: Mission, registry: Registry) -> Iterator[str]:
    """Yield what the plugins expect of the steps of a mission."""
    for action in actions(mission.all_steps):
        plugin = registry.find("task", action.verb)
        if (expects := plugin.offer.expects) is not None:
            call = partial(_texts, expects, **action.options)
            try:
                yield from guarded("task", plugin, call, mission.scene, action.rows)
            except PluginError as error:
                problem = Problem(action.at, error.message, error.code)
                raise InputError(mission.file.located([problem])) from error


def _texts(expects: Callable[..., Iterable[str]], *arguments: Any, **options: Any) -> list[str]:
    """Return what a plugin expects, inside of the guard that names it."""
    return list(expects(*arguments, **options))


def _steps(document: Document, registry: Registry) -> str:
    """Check steps by themselves, whatever mission includes them."""
    check_alone(document, schema.compose_steps(registry.offers()))
    steps, parameters = len(document.data["mission"]), document.data.get("parameters", {})
    needed = ", ".join(name for name, value in parameters.items() if value is None)
    many = "steps" if steps > 1 else "step"
    values = f", with a value for {needed}" * bool(needed)
    return f"{steps} {many} for missions to include{values}{lacking(document)}"


def check_world(file: SourceFile, _registry: Registry) -> str:
    """Return what a world is good for."""
    return f"{world(file).name!r}, a world that can be flown in"


def check_camera(file: SourceFile, _registry: Registry) -> str:
    """Return what a camera is good for."""
    if problems := file.located(camera_problems(file.data)):
        raise InputError(problems)
    return f"{file.data['name']!r}, a camera for missions"
