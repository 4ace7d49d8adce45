"""The format of missions in YAML, and its kinds of files: missions, steps, worlds and cameras."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.commands import PIPELINE_KINDS
from star_core.formats import FileKindSpec, FormatSpec


@hookimpl
def star_formats() -> Iterator[FormatSpec]:
    yield FormatSpec(
        name="yaml",
        summary="Missions, worlds and other files in YAML.",
        load=deferred("star_yaml.mission_loader:load"),
        check=deferred("star_yaml.check_file:check_file"),
        resembles=deferred("star_yaml.input_file:resembles"),
        read=deferred("star_yaml.schema:read_as"),
        values=deferred("star_yaml.yaml_reader:values"),
        schema=deferred("star_yaml.editor_schema:editor_schema"),
        missions=deferred("star_yaml.input_file:missions"),
        check_choice=deferred("star_yaml.schema:choice_problems"),
        restore=deferred("star_yaml.mission_loader:restore"),
    )


@hookimpl
def star_file_kinds() -> Iterator[FileKindSpec]:
    yield FileKindSpec(
        name="mission",
        summary="A mission: world, swarm, plugins and steps.",
        noun="a mission",
        # `agents` and `drones` are mistakes for `swarm`
        keys=("mission", "world", "swarm", "let", "on", "agents", "drones", *PIPELINE_KINDS),
        schema=deferred("star_yaml.schema:mission_schema"),
        hints={"study": "`star run` flies it"},
    )
    yield FileKindSpec(
        name="steps",
        summary="Steps that missions include.",
        noun="a file of steps",
        keys=("mission", "parameters"),
        schema=deferred("star_yaml.schema:steps_schema"),
        hints={"mission": "name a mission that includes it"},
    )
    yield FileKindSpec(
        name="world",
        summary="A world: fence, obstacles, landmarks and targets.",
        noun="a world",
        keys=("fence", "obstacles", "landmarks", "targets", "base_stations", "anchors"),
        schema=deferred("star_yaml.schema:world_schema"),
        check=deferred("star_yaml.check_file:check_world"),
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
        schema=deferred("star_yaml.schema:camera_schema"),
        check=deferred("star_yaml.check_file:check_camera"),
        hints={"mission": "name a mission that has it"},
    )
