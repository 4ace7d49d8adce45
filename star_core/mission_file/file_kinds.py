"""The kinds of files that missions are made of: missions, steps, worlds and cameras."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from star_core.errors import InputError
from star_core.hookspecs import hookimpl
from star_core.plugin_support.option_schema import PARTS
from star_core.plugin_support.specs import FileKindSpec, Problem, SourceFile
from star_core.registry import Registry


@hookimpl
def star_file_kinds() -> Iterator[FileKindSpec]:
    yield FileKindSpec(
        name="mission",
        summary="A mission: world, swarm, plugins and steps.",
        noun="a mission",
        keys=("mission", "world", "swarm", "agents", "drones", *PARTS),  # `agents` is for `swarm`
        schema=_mission_schema,
        hints={"study": "`star run` flies it"},
    )
    yield FileKindSpec(
        name="steps",
        summary="Steps that missions include.",
        noun="a file of steps",
        keys=("mission", "parameters"),
        schema=_steps_schema,
        hints={"mission": "name a mission that includes it"},
    )
    yield FileKindSpec(
        name="world",
        summary="A world: fence, obstacles, landmarks and targets.",
        noun="a world",
        keys=("fence", "obstacles", "landmarks", "targets"),
        schema=lambda _registry: _load("world"),
        check=_check_world,
        hints={"mission": "name a mission that is flown in it"},
    )
    yield FileKindSpec(
        name="camera",
        summary="A camera of agents: its image, lens and pose.",
        noun="a camera",
        keys=(
            *("width", "height", "matrix", "distortion", "position", "exposure", "readout"),
            *("roll_deg", "pitch_deg", "yaw_deg"),
        ),
        schema=lambda _registry: _load("camera"),
        check=_check_camera,
        hints={"mission": "name a mission that has it"},
    )


def _load(name: str) -> dict[str, Any]:
    from star_core.mission_file.schema import load

    return load(name)


def _mission_schema(registry: Registry) -> dict[str, Any]:
    from star_core.mission_file.schema import compose

    return compose(registry.offers())


def _steps_schema(registry: Registry) -> dict[str, Any]:
    from star_core.mission_file.schema import compose_steps

    return compose_steps(registry.offers())


def _check_world(file: SourceFile, _registry: Registry) -> str:
    from star_core.mission_file.world_loader import world

    return f"{world(file).name!r}, a world that can be flown in"


def _check_camera(file: SourceFile, _registry: Registry) -> str:
    from star_core.world.camera import camera_faults

    faults = camera_faults(file.data)
    if found := file.located(Problem(path, text, "invalid-camera") for path, text in faults):
        raise InputError(found)
    return f"{file.data['name']!r}, a camera for missions"
