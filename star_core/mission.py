"""A mission: read from YAML, checked against its schema and its world, frozen."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from star_core.errors import InputError, PluginError
from star_core.mission_file import schema
from star_core.mission_file import world_loader as world_file
from star_core.mission_file.checks import airborne_state, feasibility
from star_core.mission_file.checks import references as checks
from star_core.mission_file.includes import lacking, with_files
from star_core.mission_file.located import Document, kind_of, read
from star_core.mission_file.overrides import override
from star_core.mission_file.sound_parts import Incomplete, sound_parts
from star_core.mission_file.step_tree import Action, Node, Parallel, Repeat, actions
from star_core.plugin_schema import PARTS, SHARED
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
        collisions: ``fail`` if a collision fails the mission, ``record`` if it is only recorded.
        document: The mission as read, with what was set on the command line.
        world: The world as read.
    """

    name: str
    scene: Scene
    parts: Mapping[str, Part]
    steps: tuple[Node, ...]
    safety: Mapping[str, Mapping[str, Any]]
    reserve: Mapping[str, Any]
    collisions: str
    document: Document
    world: Document

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
    if why := _other(written):
        raise InputError(f"{written.path}: {why}")
    composed = schema.compose(registry.offers())
    document, problems = with_files(override(written, assignments))
    refused = schema.faults(document, composed)
    problems += schema.located(document, refused)
    world, room = _world(document, problems)
    sound = sound_parts(document.data, refused)
    if sound is None:
        raise InputError(_in_file_order(problems, document.path), "invalid-option")
    scene = _scene(document, sound, room or NO_WORLD, realtime=_realtime(sound, registry))
    problems += checks.of_mission(document, sound, scene, registry, world_known=room is not None)
    groups = checks.agents_by_name(scene)
    steps = tuple(
        _node(step, ("mission", i), document, groups, registry)
        for i, step in enumerate(sound["mission"])
    )
    problems += _step_problems(steps, sound, scene, registry)
    if problems or world is None:
        raise InputError(_in_file_order(problems, document.path), "invalid-option")
    return Mission(
        name=sound["name"],
        scene=scene,
        parts={kind: _part(kind, sound[kind], registry) for kind in PARTS},
        steps=steps,
        safety=sound.get("safety", {}),
        reserve=sound.get("reserve", {}),
        collisions=sound.get("collisions", "fail"),
        document=document,
        world=world,
    )


def _step_problems(
    steps: Sequence[Node], data: Mapping[str, Any], scene: Scene, registry: Registry
) -> list[str]:
    """Return which steps find their agents in the wrong place, or obstacles above them."""
    reserve = data.get("reserve", {})
    names = reserve.get("agents", [])
    if not {*names} <= {*scene.names} or (isinstance(reserve, Incomplete) and not names):
        return []  # the agents that are in the mission at first are not known
    reserved = [scene.names.index(name) for name in names]
    deeds = [(step.place, step.verb, step.options, step.rows) for step in actions(steps)]
    heights = [agent.start[2] for agent in scene.agents]
    return [
        *airborne_state.faults(
            steps,
            scene.names,
            heights,
            reserved,
            lambda verb: registry.find("task", verb).offer,
        ),
        *feasibility.climb_faults(deeds, reserved, scene, registry),
    ]


def _in_file_order(problems: Iterable[str], path: Path) -> list[str]:
    """Return each problem once: those of the file at `path` by line and column, then the others."""
    located = re.compile(rf"{re.escape(str(path))}:(\d+):(\d+): ")

    def order(problem: str) -> tuple[bool, int, int]:
        found = located.match(problem)
        return (False, int(found[1]), int(found[2])) if found else (True, 0, 0)

    return sorted(dict.fromkeys(problems), key=order)


def _other(document: Document) -> str:
    """Say what a file is that is no mission, and which mission to name; empty for a mission."""
    match kind_of(document.data):
        case "steps":
            lacks = lacking(document)
            return f"holds steps for missions to include: name a mission that includes it{lacks}"
        case "world":
            return "is a world: name a mission that is flown in it"
        case "camera":
            return "is a camera: name a mission that has it"
        case _:
            return ""


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
    cameras = {
        name: Camera() if isinstance(given, Incomplete) else _camera(given)
        for name, given in data.get("cameras", {}).items()
    }
    given_limits = data.get("limits", {})
    limits = {**(UNLIMITED if isinstance(given_limits, Incomplete) else {}), **given_limits}
    if "height" in limits:
        limits["height"] = tuple(limits["height"])
    return Scene(
        agents=tuple(
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
    """Rows of each group's agents; unknown names are reported by `checks`."""
    row = {name: i for i, name in enumerate(data["swarm"])}
    return {
        name: tuple(row[member] for member in members if member in row)
        for name, members in data.get("groups", {}).items()
    }


def _realtime(data: Mapping[str, Any], registry: Registry) -> bool:
    """Whether mission time goes on by itself with the transport that is named."""
    transport = data["transport"]
    use = transport if isinstance(transport, str) else transport["use"]
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
    if verb == "each" and not isinstance(given, Incomplete):
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
    options = {key: value for key, value in given.items() if key not in SHARED}
    try:
        source = registry.find("task", verb).source
    except PluginError:  # reported as a reference
        source, given = Source(""), Incomplete(given)
    return Action(
        verb=verb,
        source=source,
        rows=checks.rows_of(given.get("agents", "all"), groups),
        options=Incomplete(options) if isinstance(given, Incomplete) else options,
        until=given.get("until"),
        timeout=given.get("timeout"),
        on_failure=given.get("on_failure", "abort"),
        place=document.place(path),
    )
