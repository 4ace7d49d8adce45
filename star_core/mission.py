"""A mission: read from YAML, checked against its schema and its world, frozen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from star_core import aloft, checks, room, schema, world_file
from star_core.camera import Camera
from star_core.camera_file import furnished
from star_core.document import PARTS, Document, kind_of, override, read
from star_core.errors import InputError, PluginError
from star_core.include import expanded, lacking
from star_core.options import SHARED
from star_core.registry import Registry, Source
from star_core.scene import Agent, Limits, Scene, inside
from star_core.steps import Action, Node, Parallel, Repeat, actions
from star_core.world import World


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
        reserve: Who relieves others, and when; empty if nobody does.
        document: The mission as read, with what was set on the command line.
        world: The world as read.
    """

    name: str
    scene: Scene
    parts: Mapping[str, Part]
    steps: tuple[Node, ...]
    safety: Mapping[str, Mapping[str, Any]]
    reserve: Mapping[str, Any]
    document: Document
    world: Document

    @property
    def reserve_rows(self) -> tuple[int, ...]:
        """Rows of the agents that are in reserve at the start."""
        return tuple(self.scene.names.index(name) for name in self.reserve.get("agents", ()))


def load(path: Path | str, registry: Registry, assignments: Sequence[str] = ()) -> Mission:
    """Read the mission at `path`, set what `assignments` (``path=value``) say, and check it.

    Raises:
        InputError: The mission or its world cannot be flown; every reason found is listed.
    """
    found_there = read(Path(path))
    if why := _other(found_there):
        raise InputError(f"{path}: {why}")
    composed = schema.compose(registry.offers())
    document = _with_files(override(found_there, assignments), composed)
    found = schema.problems(document, composed)
    if found and not isinstance(document.data.get("world"), str):
        raise InputError(found)
    try:
        world = _world_document(document)
        place = world_file.world(world)
    except InputError as error:
        raise InputError([*found, *error.problems]) from None
    if found:
        raise InputError(found)
    scene = _scene(document, place, realtime=_realtime(document, registry))
    if found := checks.of_mission(document, scene, registry):
        raise InputError(found)
    groups = checks.agents_by_name(scene)
    steps = tuple(
        _node(step, ("mission", i), document, groups, registry)
        for i, step in enumerate(document.data["mission"])
    )
    reserve = document.data.get("reserve", {})
    reserved = [scene.names.index(name) for name in reserve.get("agents", ())]
    deeds = [(step.place, step.verb, step.options, step.rows) for step in actions(steps)]
    if found := [
        *aloft.faults(
            steps,
            scene.names,
            [agent.start[2] for agent in scene.agents],
            reserved,
            lambda verb: registry.find("task", verb).offer,
        ),
        *room.climb_faults(deeds, reserved, scene, registry),
    ]:
        raise InputError(found)
    return Mission(
        name=document.data["name"],
        scene=scene,
        parts={kind: _part(kind, document.data[kind], registry) for kind in PARTS},
        steps=steps,
        safety=document.data.get("safety", {}),
        reserve=reserve,
        document=document,
        world=world,
    )


def _other(document: Document) -> str:
    """Say what a file is that is no mission, and which mission to name; empty for a mission."""
    match kind_of(document):
        case "steps":
            lacks = lacking(document)
            return f"holds steps for missions to include: name a mission that includes it{lacks}"
        case "world":
            return "is a world: name a mission that is flown in it"
        case "camera":
            return "is a camera: name a mission that has it"
        case _:
            return ""


def _with_files(written: Document, composed: Mapping[str, Any]) -> Document:
    """Return a mission with the cameras and the steps that it names files of put in.

    Raises:
        InputError: A file will not do; what else is wrong with the mission is told after that.
    """
    document, problems = written, list[str]()
    for read_in in (furnished, expanded):
        try:
            document = read_in(document)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError([*problems, *schema.problems(written, composed)])
    return document


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


def _scene(document: Document, world: World, *, realtime: bool) -> Scene:
    data = document.data
    cameras = {name: _camera(given) for name, given in data.get("cameras", {}).items()}
    limits = dict(data.get("limits", {}))
    if "height" in limits:
        limits["height"] = tuple(limits["height"])
    return Scene(
        agents=tuple(
            Agent(
                name=name,
                start=world_file.point(given["start"]),
                yaw=math.radians(given.get("yaw_deg", 0.0)),
                uri=given.get("uri"),
                camera=cameras.get(given.get("camera"), Camera() if "camera" in given else None),
            )
            for name, given in data["swarm"].items()
        ),
        period=1 / data.get("rate", 20),
        world=world,
        limits=Limits(**limits),
        seed=data.get("seed", 0),
        realtime=realtime,
        folder=document.path.parent,
        groups=_groups(data),
    )


def _groups(data: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """Rows of each group's agents; `checks` says who is no agent, and where."""
    row = {name: i for i, name in enumerate(data["swarm"])}
    return {
        name: tuple(row[member] for member in members if member in row)
        for name, members in data.get("groups", {}).items()
    }


def _realtime(document: Document, registry: Registry) -> bool:
    """Whether mission time goes on by itself with the transport that is named."""
    transport = document.data["transport"]
    use = transport if isinstance(transport, str) else transport["use"]
    try:
        return registry.find("transport", use).offer.realtime
    except PluginError:  # `checks` says so, and where
        return False


def _camera(given: Mapping[str, Any]) -> Camera:
    values: dict[str, Any] = {
        name.removesuffix("_deg"): math.radians(value) if name.endswith("_deg") else value
        for name, value in given.items()
    }
    for name in values.keys() & {"matrix", "distortion", "position"}:
        values[name] = tuple(map(float, values[name]))
    return Camera(**values)


def _part(kind: str, given: str | Mapping[str, Any], registry: Registry) -> Part:
    options = {} if isinstance(given, str) else {k: v for k, v in given.items() if k != "use"}
    use = given if isinstance(given, str) else given["use"]
    return Part(kind, use, options, registry.find(kind, use).source)


def _node(
    step: Mapping[str, Any],
    path: tuple[str | int, ...],
    document: Document,
    groups: Mapping[str, tuple[int, ...]],
    registry: Registry,
) -> Node:
    ((verb, given),) = step.items()
    if verb == "parallel":
        return Parallel(
            tuple(
                _node(s, (*path, verb, i), document, groups, registry) for i, s in enumerate(given)
            )
        )
    if verb == "each":
        return Parallel(
            tuple(
                Repeat(
                    1,
                    tuple(
                        _node(s, (*path, verb, "steps", i), document, {"all": (row,)}, registry)
                        for i, s in enumerate(given["steps"])
                    ),
                )
                for row in checks.rows_of(given.get("agents", "all"), groups)
            )
        )
    if verb == "repeat":
        return Repeat(
            given["times"],
            tuple(
                _node(s, (*path, verb, "steps", i), document, groups, registry)
                for i, s in enumerate(given["steps"])
            ),
        )
    return Action(
        verb=verb,
        source=registry.find("task", verb).source,
        rows=checks.rows_of(given.get("agents", "all"), groups),
        options={key: value for key, value in given.items() if key not in SHARED},
        until=given.get("until"),
        timeout=given.get("timeout"),
        on_failure=given.get("on_failure", "abort"),
        place=document.place(path),
    )
