"""A mission: read from YAML, checked against its schema and its world, frozen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from star_core.errors import InputError, PluginError
from star_core.mission_file import schema
from star_core.mission_file import world_loader as world_file
from star_core.mission_file.checks.references import of_mission
from star_core.mission_file.file_kinds import require_kind
from star_core.mission_file.includes import with_files
from star_core.mission_file.located import Document
from star_core.mission_file.overrides import override
from star_core.mission_file.sound_parts import Incomplete, Refused, sound_parts
from star_core.mission_file.step_tree import Node, StepBuilder
from star_core.mission_file.yaml_reader import read
from star_core.plugin_schema import PARTS
from star_core.registry import Registry, Source
from star_core.scene import Agent, Limits, Scene, inside
from star_core.world.camera import Camera
from star_core.world.world import Fence, World

# What stands for the parts of a mission that are not known while the others are checked.
NO_WORLD: Final = World("", Fence((-math.inf,) * 3, (math.inf,) * 3))
UNKNOWN_START: Final = (math.nan,) * 3
UNLIMITED: Final[Mapping[str, Any]] = {
    "speed": math.inf,
    "acceleration": math.inf,
    "height": (-math.inf, math.inf),
    "separation": 0.0,
    "vertical_separation": 1.0,
}


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
    scene = _scene(document, data, room or NO_WORLD, realtime=_realtime(data, registry))
    builder = StepBuilder(document, refused, scene, _uncertain_groups(document, data), registry)
    steps = builder.build()
    found = [*of_mission(document, data, steps, scene, registry, world_known=room is not None)]
    problems += document.located(
        [*builder.problems, *(problem for problem in found if not problem.warning)]
    )
    if problems or world is None:
        raise InputError(document.in_order(problems))
    return Mission(
        name=data["name"],
        scene=scene,
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


def _uncertain_groups(document: Document, data: Mapping[str, Any]) -> set[str] | None:
    """Return the names of groups whose agents are not all known; None if no name is."""
    if not isinstance(document.data.get("groups", {}), dict):
        return None
    agents = {*data["swarm"]}
    return {name for name, held in data["groups"].items() if not held or {*held} - agents}


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


def _scene(document: Document, data: Mapping[str, Any], world: World, *, realtime: bool) -> Scene:
    unknown = UNLIMITED if isinstance(data["limits"], Incomplete) else {}
    limits = {**unknown, **data["limits"]}
    limits["height"] = tuple(limits["height"])
    return Scene(
        agents=agents(data),
        period=1 / data["rate"],
        world=world,
        limits=Limits(**limits),
        seed=data["seed"],
        realtime=realtime,
        folder=document.path.parent,
        groups=_groups(data),
    )


def agents(data: Mapping[str, Any]) -> tuple[Agent, ...]:
    """Return the agents of a mission, in the order of its ``swarm``."""
    cameras = {
        name: Camera() if isinstance(given, Incomplete) else _camera(given)
        for name, given in data.get("cameras", {}).items()
    }
    return tuple(
        Agent(
            name=name,
            start=world_file.point(given.get("start", UNKNOWN_START)),
            yaw=math.radians(given.get("yaw_deg", 0.0)),
            uri=given.get("uri"),
            camera=cameras.get(
                given.get("camera"),
                Camera() if "camera" in given or isinstance(given, Incomplete) else None,
            ),
        )
        for name, given in data["swarm"].items()
    )


def _groups(data: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """Rows of each group's agents; unknown names are reported by `checks`."""
    row = {name: i for i, name in enumerate(data["swarm"])}
    return {
        name: tuple(row[member] for member in members if member in row)
        for name, members in data.get("groups", {}).items()
    }


def _realtime(data: Mapping[str, Any], registry: Registry) -> bool:
    """Whether mission time goes on by itself with the transport that is named."""
    use = data["transport"]["use"]
    try:
        return bool(registry.find("transport", use).offer.realtime)
    except PluginError:  # reported as a reference
        return False


def _camera(given: Mapping[str, Any]) -> Camera:
    values: dict[str, Any] = {
        name.removesuffix("_deg"): math.radians(value) if name.endswith("_deg") else value
        for name, value in given.items()
    }
    for name in values.keys() & {"matrix", "distortion", "position"}:
        values[name] = tuple(map(float, values[name]))
    return Camera(**values)


def _part(kind: str, given: Mapping[str, Any], registry: Registry) -> Part:
    options = {key: value for key, value in given.items() if key != "use"}
    return Part(kind, given["use"], options, registry.find(kind, given["use"]).source)
