"""A mission: read from YAML, checked against its schema and its world, frozen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from star_core.errors import InputError, PluginError
from star_core.mission_file import schema
from star_core.mission_file import world_loader as world_file
from star_core.mission_file.checks.references import of_mission
from star_core.mission_file.file_kinds import require_kind
from star_core.mission_file.includes import with_files
from star_core.mission_file.located import Document
from star_core.mission_file.overrides import override
from star_core.mission_file.scene_builder import scene, uncertain_groups
from star_core.mission_file.sound_parts import Refused, sound_parts
from star_core.mission_file.step_tree import Node, StepBuilder
from star_core.mission_file.yaml_reader import read
from star_core.plugin_support.discovery import Source
from star_core.plugin_support.option_schema import PARTS
from star_core.registry import Registry
from star_core.scene import Scene, inside
from star_core.world.world import World


@dataclass(frozen=True, slots=True)
class Part:
    """Which plugin to use, with what, and whose it is."""

    kind: str
    use: str
    options: Mapping[str, Any]
    source: Source

    def __str__(self) -> str:
        return f"{self.kind} {self.use!r} ({self.source})"


@dataclass(frozen=True, slots=True)
class Mission:
    """What to fly.

    Attributes:
        name: For records.
        scene: What every plugin is made with.
        parts: The transport, localizer, planner and avoider, by kind.
        steps: What to do, one after the other.
        safety: What becomes of agents in trouble, by the trouble.
        reserve: Agents that replace others, and when; empty if there are none.
        plugin_strikes: Number of failures of a plugin in flight at which all agents land.
        collisions: ``fail`` if a collision fails the mission, ``record`` if it is only recorded.
        document: The mission as read, with what was set on the command line.
        world: The world as read.
        warnings: What is probably a mistake, one line each, with its location.
    """

    name: str
    scene: Scene
    parts: Mapping[str, Part]
    steps: tuple[Node, ...]
    safety: Mapping[str, Mapping[str, Any]]
    reserve: Mapping[str, Any]
    plugin_strikes: int
    collisions: str
    document: Document
    world: Document
    warnings: tuple[str, ...] = ()

    def with_seed(self, seed: int) -> Mission:
        """Return the same mission with another seed."""
        root = self.document.root
        number = replace(root, data=seed)
        document = replace(self.document, root=replace(root, data={**root.map(), "seed": number}))
        return replace(self, scene=replace(self.scene, seed=seed), document=document)

    @property
    def reserve_rows(self) -> tuple[int, ...]:
        """Rows of the agents that are in reserve at the start."""
        return tuple(self.scene.names.index(name) for name in self.reserve.get("agents", ()))


def load(path: Path | str, registry: Registry, assignments: Sequence[str] = ()) -> Mission:
    """Read the mission at `path`, set what `assignments` (``path=value``) say, and check it.

    Raises:
        InputError: The mission or its world cannot be flown; every reason found is listed.
    """
    return checked(read(Path(path)), registry, assignments)


def checked(written: Document, registry: Registry, assignments: Sequence[str] = ()) -> Mission:
    """Return the mission that a document, changed by `assignments`, describes.

    Raises:
        InputError: The mission or its world cannot be flown; every reason found is listed.
    """
    require_kind(written, "mission")
    composed = schema.compose(registry.offers())
    document, problems = with_files(override(written, assignments))
    faults = schema.faults(document, composed)
    problems += schema.located(document, faults)
    world, room = _world(document, problems)
    refused = Refused(faults)
    data = sound_parts(document.data, refused, composed)
    if data is None:
        raise InputError(document.in_order(problems))
    realtime = _realtime(data, registry)
    flight = scene(document.path.parent, data, room, realtime=realtime)
    uncertain = uncertain_groups(document.data, data)
    builder = StepBuilder(document, refused, flight, uncertain, registry)
    steps = builder.build()
    found = [*of_mission(document, data, steps, flight, registry, world_known=room is not None)]
    problems += document.located(
        [*builder.problems, *(problem for problem in found if not problem.warning)]
    )
    if problems or world is None:
        raise InputError(document.in_order(problems))
    return Mission(
        name=data["name"],
        scene=flight,
        parts={kind: _part(kind, data[kind], registry) for kind in PARTS},
        steps=steps,
        safety=data["safety"],
        reserve=data["reserve"],
        plugin_strikes=data["plugin_strikes"],
        collisions=data["collisions"],
        document=document,
        world=world,
        warnings=tuple(document.located(problem for problem in found if problem.warning)),
    )


def _world(document: Document, problems: list[str]) -> tuple[Document | None, World | None]:
    """Return the world that a mission names, read and made; its mistakes join `problems`."""
    if not isinstance(document.data.get("world"), str) or not document.data["world"]:
        return None, None
    try:
        world = _world_document(document)
        return world, world_file.world(world)
    except InputError as error:
        problems += error.problems
        return None, None


def _world_document(document: Document) -> Document:
    """Read the world that a mission names.

    Raises:
        InputError: There is no such file inside the mission's folder, or it cannot be read.
    """
    try:
        path = inside(document.path.parent, document.data["world"])
    except InputError as error:
        raise InputError([document.problem(("world",), str(error))]) from None
    return schema.read_as(path, "world")


def _realtime(data: Mapping[str, Any], registry: Registry) -> bool:
    """Whether mission time goes on by itself with the transport that is named."""
    use = data["transport"]["use"]
    try:
        return bool(registry.find("transport", use).offer.realtime)
    except PluginError:  # reported as a reference
        return False


def _part(kind: str, given: Mapping[str, Any], registry: Registry) -> Part:
    options = {key: value for key, value in given.items() if key != "use"}
    return Part(kind, given["use"], options, registry.find(kind, given["use"]).source)
