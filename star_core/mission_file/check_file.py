"""Checks a file: a mission, steps, a world, a camera or faults."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from star_core.errors import InputError
from star_core.mission_file import schema
from star_core.mission_file.fault_file import check_faults
from star_core.mission_file.includes import check_alone
from star_core.mission_file.input_file import kind_of, lacking, override, read
from star_core.mission_file.located import Document
from star_core.mission_file.mission_loader import checked
from star_core.mission_file.world_loader import world
from star_core.plugin_support.specs import Problem
from star_core.registry import Registry
from star_core.world.camera import camera_faults


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
    others = {"steps": _steps, "world": _world, "camera": _camera, "faults": check_faults}
    if found := others.get(kind_of(document.data)):
        return f"{path}: {found(override(document, assignments), registry)}", ()
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


def _world(document: Document, _registry: Registry) -> str:
    """Check a world, whatever mission is flown in it."""
    if found := schema.problems(document, schema.load("world")):
        raise InputError(found)
    return f"{world(document).name!r}, a world that can be flown in"


def _camera(document: Document, _registry: Registry) -> str:
    """Check a camera's file, whatever mission has it."""
    found = schema.problems(document, schema.load("camera"))
    if found := found or document.located(
        Problem(path, message, "invalid-camera") for path, message in camera_faults(document.data)
    ):
        raise InputError(found)
    return f"{document.data['name']!r}, a camera for missions"
