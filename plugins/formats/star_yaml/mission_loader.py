"""A mission: read, checked against its schema and its world, and frozen.

Whatever is wrong with it, its scene is made of what is sound, so that all other checks still run.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from star_core import (
    Agent,
    Camera,
    Fence,
    InputError,
    Limits,
    Mission,
    PluginError,
    Registry,
    Scene,
    World,
)
from star_core.commands import PIPELINE_KINDS, Found
from star_core.formats import PluginChoice, inside
from star_core.toolkit import PluginGuard, fill_defaults
from star_yaml import schema, world_loader
from star_yaml.checks.plugin_checks import options_of
from star_yaml.checks.references import of_mission
from star_yaml.document import Document
from star_yaml.includes import resolved
from star_yaml.input_file import override, read, require_kind
from star_yaml.schema import UNKNOWN, Incomplete, Refused
from star_yaml.step_tree import StepBuilder
from star_yaml.yaml_reader import parse

# What stands for the parts of a mission that are not known while the others are checked.
NO_WORLD: Final = World("", Fence((-math.inf,) * 3, (math.inf,) * 3))
UNKNOWN_START: Final = (math.nan,) * 3
UNLIMITED: Final[Mapping[str, Any]] = {
    "speed": math.inf,
    "acceleration": math.inf,
    "height": (-math.inf, math.inf),
    "separation": 0.0,
    "vertical_separation": 1.0,
    "uncertainty_margin": 0.0,
}

FLAGS: Final = (
    *("exact_odometry", "heights_above_surface", "flow_deck"),
    *("detects_tags", "measures_positions"),
)
"""Functions of a transport's offer that return whether something is so of its scene."""


def load(path: Path | str, registry: Registry, assignments: Sequence[str] = ()) -> Mission:
    """Read the mission at `path`, apply `assignments` (``path=value``), and check it.

    Raises:
        InputError: The mission or its world cannot be flown; every reason found is listed.
    """
    return checked(read(Path(path)), registry, assignments)


def checked(written: Document, registry: Registry, assignments: Sequence[str] = ()) -> Mission:
    """Return the mission that a document, changed by `assignments`, describes.

    Raises:
        InputError: The mission or its world cannot be flown; every reason found is listed.
    """
    require_kind(written, "mission", registry)
    composed = schema.compose(registry.offers())
    document, problems, files = resolved(override(written, assignments), composed, registry)
    faults = schema.faults(document, composed)
    problems += schema.located(document, faults)
    world, room = _world(document, problems, registry)
    refused = Refused(faults)
    data = sound_parts(document.data, refused, composed)
    if data is None:
        raise InputError(document.in_order(problems))
    data |= {kind: _with_defaults(kind, data[kind], registry) for kind in PIPELINE_KINDS}
    flight = scene(document.path.parent, data, room)
    flight = replace(flight, **_scene_properties(data, registry))
    uncertain = uncertain_groups(document.data, data)
    builder = StepBuilder(document, refused, flight, uncertain, registry)
    steps, reactions = builder.build(), builder.reactions()
    mission_problems = [
        *of_mission(
            document, data, steps, reactions, flight, registry, world_known=room is not None
        )
    ]
    problems += document.located(
        [*builder.problems, *(problem for problem in mission_problems if not problem.warning)]
    )
    if problems or world is None:
        raise InputError(document.in_order(problems))
    return Mission(
        name=data["name"],
        scene=flight,
        plugins={
            kind: _plugin(kind, data[kind], document.data[kind], registry)
            for kind in PIPELINE_KINDS
        },
        steps=steps,
        reactions=reactions,
        safety=data["safety"],
        reserve=data["reserve"],
        plugin_strikes=data["plugin_strikes"],
        collisions=data["collisions"],
        source=document.data,
        file=document,
        world_file=world,
        files=files,
        warnings=tuple(
            document.located(problem for problem in mission_problems if problem.warning)
        ),
    )


def _world(
    document: Document, problems: list[str], registry: Registry
) -> tuple[Document | None, World | None]:
    """Return the world that a mission names, read and made; its mistakes join `problems`."""
    name = document.data.get("world")
    if not isinstance(name, str) or not name:
        return None, None
    try:
        path = inside(document.path.parent, name)
    except InputError as error:
        problems.append(document.problem(("world",), str(error)))
        return None, None
    try:
        world = schema.read_as(path, "world", registry)
        return world, world_loader.world(world)
    except InputError as error:
        problems += error.problems
        return None, None


def _find(kind: str, choice: Mapping[str, Any], registry: Registry) -> Found | None:
    """Return the plugin of a choice; None without it, which is reported as a reference."""
    try:
        return registry.find(kind, choice["use"])
    except PluginError:
        return None


def _scene_properties(data: Mapping[str, Any], registry: Registry) -> dict[str, Any]:
    """Return what a scene states about the transport and the localizer that are named."""
    localizer = _find("localizer", data["localizer"], registry)
    properties: dict[str, Any] = {
        "reports_in_map": localizer is not None and bool(localizer.offer.reports_in_map)
    }
    if (plugin := _find("transport", data["transport"], registry)) is None:
        return properties
    offer, properties["realtime"] = plugin.offer, bool(plugin.offer.realtime)
    options = fill_defaults(options_of(data["transport"]), offer.options)  # some may be refused
    for name in (*FLAGS, "measurement_errors", "onboard_system"):
        if (function := getattr(offer, name)) is not None:
            with PluginGuard(f"transport {offer.name!r} ({plugin.source})"):
                value = function(**options)
                properties[name] = bool(value) if name in FLAGS else value
    return properties


def _with_defaults(kind: str, choice: dict[str, Any], registry: Registry) -> dict[str, Any]:
    """Return the choice of a plugin with the defaults of its options, if these are known."""
    plugin = None if isinstance(choice, Incomplete) else _find(kind, choice, registry)
    return choice if plugin is None else fill_defaults(choice, plugin.offer.options)


def _plugin(
    kind: str, choice: Mapping[str, Any], written: str | Mapping[str, Any], registry: Registry
) -> PluginChoice:
    source = registry.find(kind, choice["use"]).source
    options = {} if isinstance(written, str) else options_of(written)
    return PluginChoice(kind, choice["use"], options_of(choice), source, options)


def sound_parts(
    data: Mapping[str, Any], refused: Refused, schema: Mapping[str, Any]
) -> dict[str, Any] | None:
    """Return a mission besides its steps without what its schema refuses, with its defaults.

    Names stay known, so that references to an agent, a group or a camera with a mistake in it are
    no mistakes themselves. The choice of a plugin is a map with the key ``use``.

    Args:
        data: The mission as read.
        refused: What its schema refuses.
        schema: Of missions, for the defaults.

    Returns:
        None if it is not even known which agents there are.
    """

    def named(key: str, unknown: Any) -> dict[str, Any]:
        """Return the values of a map by name; `unknown` for those that are refused."""
        mapping = data.get(key, {})
        if not isinstance(mapping, dict):
            return Incomplete()
        sound = {name: refused.without(value, (key, name)) for name, value in mapping.items()}
        kind = list if isinstance(unknown, list) else dict
        return {
            name: value if isinstance(value, kind) else unknown for name, value in sound.items()
        }

    swarm, cameras = named("swarm", Incomplete()), named("cameras", Incomplete())
    if not swarm:
        return None
    for name, camera in cameras.items():
        if "file" in camera:  # which could not be read, or it would have been replaced
            cameras[name] = Incomplete(camera)
    defaulted = ("rate", "seed", "plugin_strikes", "collisions")
    keys = (*PIPELINE_KINDS, *defaulted, "limits", "safety", "reserve", "name", "world")
    sound = {key: refused.without(data[key], (key,)) for key in keys if key in data}
    sound = {key: value for key, value in sound.items() if value is not None}
    sound |= {"swarm": swarm, "cameras": cameras, "groups": named("groups", [])}
    for kind in PIPELINE_KINDS:
        sound[kind] = _choice(sound.get(kind))
    properties = schema["properties"]
    for key in ("limits", "safety", "reserve"):
        value = sound.get(key, Incomplete() if key in data else {})
        filled = isinstance(value, Incomplete) or (key == "reserve" and not value)
        sound[key] = value if filled else fill_defaults(value, properties[key], schema["$defs"])
    defaults = {key: properties[key]["default"] for key in defaulted}
    return defaults | sound


def _choice(choice: Any) -> dict[str, Any]:
    """Return the choice of a plugin, ``name`` or ``{use: name}``, as a map."""
    if isinstance(choice, str):
        return {"use": choice}
    return choice if isinstance(choice, dict) and "use" in choice else Incomplete(use=UNKNOWN)


def scene(folder: Path, data: Mapping[str, Any], world: World | None) -> Scene:
    """Return the scene of a mission.

    Args:
        folder: Of the mission.
        data: The mission, without what is wrong with it.
        world: None if it is not known.
    """
    unknown = UNLIMITED if isinstance(data["limits"], Incomplete) else {}
    limits = {**unknown, **data["limits"]}
    limits["height"] = tuple(limits["height"])
    return Scene(
        agents=agents(data),
        period=1 / data["rate"],
        world=world or NO_WORLD,
        limits=Limits(**limits),
        seed=data["seed"],
        folder=folder,
        groups=_groups(data),
    )


def agents(data: Mapping[str, Any]) -> tuple[Agent, ...]:
    """Return the agents of a mission, in the order of its ``swarm``."""
    cameras = {
        name: Camera() if isinstance(options, Incomplete) else _camera(options)
        for name, options in data.get("cameras", {}).items()
    }
    return tuple(
        Agent(
            name=name,
            start=world_loader.point(options.get("start", UNKNOWN_START)),
            yaw=math.radians(options.get("yaw_deg", 0.0)),
            uri=options.get("uri"),
            camera=cameras.get(
                options.get("camera"),
                Camera() if "camera" in options or isinstance(options, Incomplete) else None,
            ),
        )
        for name, options in data["swarm"].items()
    )


def restore(manifest: Mapping[str, Any], file: Path) -> tuple[tuple[Agent, ...], World]:
    """Return the agents and the world of the manifest of a flight."""
    world = world_loader.world(Document(parse(json.dumps(manifest["world"]), str(file)), file))
    return agents(manifest["mission"]), world


def _groups(data: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """Rows of each group's agents; unknown names are reported by `checks`."""
    row = {name: i for i, name in enumerate(data["swarm"])}
    return {
        name: tuple(row[member] for member in members if member in row)
        for name, members in data.get("groups", {}).items()
    }


def uncertain_groups(written: Mapping[str, Any], data: Mapping[str, Any]) -> set[str] | None:
    """Return the names of groups whose agents are not all known; None if no name is."""
    if not isinstance(written.get("groups", {}), dict):
        return None
    agents = {*data["swarm"]}
    return {name for name, members in data["groups"].items() if not members or {*members} - agents}


def _camera(options: Mapping[str, Any]) -> Camera:
    values: dict[str, Any] = {
        name.removesuffix("_deg"): math.radians(value) if name.endswith("_deg") else value
        for name, value in options.items()
    }
    for name in values.keys() & {"matrix", "distortion", "position"}:
        values[name] = tuple(map(float, values[name]))
    return Camera(**values)
