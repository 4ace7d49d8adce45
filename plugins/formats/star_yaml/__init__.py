"""The format of missions in YAML, and its kinds of files: missions, steps, worlds and cameras."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from star_core import InputError, Problem, Registry, deferred, hookimpl
from star_core.commands import PIPELINE_KINDS
from star_core.formats import FileKindSpec, FormatSpec, SourceFile

if TYPE_CHECKING:
    from star_core import Agent, World


@hookimpl
def star_formats() -> Iterator[FormatSpec]:
    yield FormatSpec(
        name="yaml",
        summary="Missions, worlds and other files in YAML.",
        load=deferred("star_yaml.mission_loader:load"),
        check=deferred("star_yaml.check_file:check_file"),
        resembles=deferred("star_yaml.input_file:resembles"),
        read=deferred("star_yaml.schema:read_as"),
        values=_values,
        schema=deferred("star_yaml.editor_schema:editor_schema"),
        missions=_missions,
        check_choice=deferred("star_yaml.schema:choice_problems"),
        restore=_restore,
    )


def _values(path: Path) -> Any:
    from star_yaml.yaml_reader import read_yaml

    return read_yaml(path, text_keys=True)


def _missions() -> dict[str, tuple[Path, str]]:
    from star_yaml.input_file import file_description, shipped_files

    return {name: (file, file_description(file)) for name, file in shipped_files().items()}


def _restore(manifest: Mapping[str, Any], file: Path) -> tuple[tuple[Agent, ...], World]:
    import json

    from star_yaml.document import Document
    from star_yaml.mission_loader import agents
    from star_yaml.world_loader import world
    from star_yaml.yaml_reader import parse

    swarm = agents(manifest["mission"])
    return swarm, world(Document(parse(json.dumps(manifest["world"]), str(file)), file))


@hookimpl
def star_file_kinds() -> Iterator[FileKindSpec]:
    yield FileKindSpec(
        name="mission",
        summary="A mission: world, swarm, plugins and steps.",
        noun="a mission",
        # `agents` and `drones` are mistakes for `swarm`
        keys=("mission", "world", "swarm", "let", "on", "agents", "drones", *PIPELINE_KINDS),
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
        keys=("fence", "obstacles", "landmarks", "targets", "base_stations", "anchors"),
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
    from star_yaml.schema import load

    return load(name)


def _mission_schema(registry: Registry) -> dict[str, Any]:
    from star_yaml.schema import compose

    return compose(registry.offers())


def _steps_schema(registry: Registry) -> dict[str, Any]:
    from star_yaml.schema import compose_steps

    return compose_steps(registry.offers())


def _check_world(file: SourceFile, _registry: Registry) -> str:
    from star_yaml.world_loader import world

    return f"{world(file).name!r}, a world that can be flown in"


def _check_camera(file: SourceFile, _registry: Registry) -> str:
    from star_core.formats import camera_faults

    faults = camera_faults(file.data)
    if problems := file.located(Problem(path, text, "invalid-camera") for path, text in faults):
        raise InputError(problems)
    return f"{file.data['name']!r}, a camera for missions"
