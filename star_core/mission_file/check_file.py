"""Checks a file of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from star_core.errors import InputError
from star_core.mission_file import schema
from star_core.mission_file.includes import check_alone
from star_core.mission_file.input_file import kind_of, lacking, override, read
from star_core.mission_file.located import Document
from star_core.mission_file.mission_loader import checked
from star_core.plugin_support.specs import FileKindSpec, Problem
from star_core.registry import Registry, guarded


def check_file(
    path: Path, assignments: Sequence[str], registry: Registry
) -> tuple[str, Sequence[str]]:
    """Return, in one line, what a file is good for, and warnings.

    Args:
        path: Of the file.
        assignments: ``path=value`` each, to be set in it first.
        registry: The plugins that there are.

    Raises:
        InputError: Something is wrong with it.
    """
    document = read(path)
    kind = registry.find("file_kind", kind_of(document.data, registry))
    if kind.offer.name == "steps":
        return f"{path}: {_steps(override(document, assignments), registry)}", ()
    if kind.offer.check is None:
        return _mission(path, document, assignments, registry)
    document = override(document, assignments)
    return f"{path}: {guarded('file kind', kind, _checked, document, kind.offer, registry)}", ()


def _checked(document: Document, kind: FileKindSpec, registry: Registry) -> str:
    """Check a file of a kind that is neither a mission nor steps."""
    if kind.schema is not None and (found := schema.problems(document, kind.schema(registry))):
        raise InputError(found)
    return kind.check(document, registry) if kind.check is not None else kind.noun


def _mission(
    path: Path, document: Document, assignments: Sequence[str], registry: Registry
) -> tuple[str, Sequence[str]]:
    mission = checked(document, registry, assignments)
    found_by_plugins = registry.manager.hook.star_check(mission=mission, registry=registry)
    problems: list[Problem] = [problem for own in found_by_plugins for problem in own]
    if errors := [problem for problem in problems if not problem.warning]:
        raise InputError(mission.document.located(errors))
    agents = len(mission.scene.agents)
    many = "agents" if agents > 1 else "agent"
    text = f"{path}: {mission.name!r} can be flown, with {agents} {many}"
    return text, (*mission.warnings, *mission.document.located(problems))


def _steps(document: Document, registry: Registry) -> str:
    """Check steps by themselves, whatever mission includes them."""
    check_alone(document, schema.compose_steps(registry.offers()))
    steps, parameters = len(document.data["mission"]), document.data.get("parameters", {})
    needed = ", ".join(name for name, value in parameters.items() if value is None)
    many = "steps" if steps > 1 else "step"
    values = f", with a value for {needed}" * bool(needed)
    return f"{steps} {many} for missions to include{values}{lacking(document)}"
