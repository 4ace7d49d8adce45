"""The facts of a mission, with its numbers and options in readable form."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from star_core import Mission, Registry
from star_core.toolkit import shortlist

MINUTE: Final = 60.0
LONG: Final = 120.0  # s: longer times are given in minutes


def seconds(time: float) -> str:
    """Return a time.

    >>> seconds(8.04), seconds(61.2), seconds(125.0)
    ('8.0 s', '61 s', '2 min 5 s')
    """
    few = 10.0  # s: shorter times are given to a tenth
    if time < LONG:
        return f"{time:.1f} s" if time < few else f"{time:.0f} s"
    minutes, rest = divmod(round(time), int(MINUTE))
    return f"{minutes} min {rest} s" if rest else f"{minutes} min"


def value(content: Any) -> str:
    """Return a value as written in a mission.

    >>> value([0.0, 1, True]), value({"shape": "line"}), value(None)
    ('[0, 1, true]', '{shape: line}', 'null')
    """
    if isinstance(content, bool) or content is None:
        return {True: "true", False: "false", None: "null"}[content]
    if isinstance(content, int | float):
        return f"{content:g}" if isinstance(content, float) else str(content)
    if isinstance(content, list | tuple):
        return "[" + ", ".join(map(value, content)) + "]"
    if isinstance(content, Mapping):
        return "{" + ", ".join(f"{key}: {value(inner)}" for key, inner in content.items()) + "}"
    return " ".join(str(content).split())


def options(values: Mapping[str, Any]) -> str:
    """Return options as text: ``height: 0.8, speed: 0.3``."""
    return ", ".join(f"{name}: {value(option)}" for name, option in values.items())


def own_options(action: Any) -> dict[str, Any]:
    """Return the options of a step's verb as written in the mission."""
    return {name: option for name, option in action.written.items() if name in action.options}


def left_out(written: Mapping[str, Any], schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a schema that are not set, with their defaults."""
    return {
        name: option["default"]
        for name, option in schema.get("properties", {}).items()
        if name not in written and isinstance(option, Mapping) and "default" in option
    }


RULES: Final[Mapping[str, str]] = {
    "battery_low": "battery below {below:g} V",
    "link_lost": "no message for {after:g} s",
    "position_lost": "not located for {after:g} s",
    "fence_near": "within {within:g} m of the fence",
    "tumbled": "tumbled, crashed, locked, rebooted or on the floor",
}


def facts(mission: Mission, registry: Registry) -> Iterator[str]:
    """Yield a line for each fact."""
    yield f"{mission.name} ({mission.file.path})"
    yield from _limits(mission)
    yield ""
    yield from _world(mission)
    yield ""
    yield from _swarm(mission)
    yield ""
    yield "plugins"
    for choice in mission.plugins.values():
        schema = registry.find(choice.kind, choice.use).offer.options
        written, rest = options(choice.written), options(left_out(choice.written, schema))
        yield f"  {choice.kind:11}{choice.use}{f'  {written}' if written else ''}"
        if rest:
            yield f"{'':13}by default {rest}"
    yield ""
    yield from _safety(mission)


def _limits(mission: Mission) -> Iterator[str]:
    scene, limits = mission.scene, mission.scene.limits
    low, high = limits.height
    yield f"  {1 / scene.period:g} ticks a second, seed {scene.seed}"
    yield (
        f"  at most {limits.speed:g} m/s and {limits.acceleration:g} m/s², from {low:g} to "
        f"{high:g} m high, {limits.separation:g} m apart, {limits.vertical_separation:g} m above "
        "each other"
    )


def _world(mission: Mission) -> Iterator[str]:
    world = mission.scene.world
    low, high = world.fence.low, world.fence.high
    size = " by ".join(f"{b - a:g}" for a, b in zip(low, high, strict=True))
    yield f"world {world.name} ({mission.world_file.path})"
    yield f"  fence      {size} m, from {value(low)} to {value(high)}"
    for kind, obstacles in (("obstacles", world.obstacles), ("virtual", world.virtual)):
        if obstacles:
            yield f"  {kind:11}{', '.join(obstacle.name for obstacle in obstacles)}"
    for kind, tags in (("landmarks", world.landmarks), ("targets", world.targets)):
        if tags:
            sheets = dict.fromkeys(tag.of for tag in tags)
            numbers = ", ".join(str(tag.id) for tag in tags)
            yield f"  {kind:11}{len(sheets)}: tags {numbers}"

    for kind, beacons in (("stations", world.base_stations), ("anchors", world.anchors)):
        if beacons:
            yield f"  {kind:11}{', '.join(beacon.name for beacon in beacons)}"


def _swarm(mission: Mission) -> Iterator[str]:
    source = mission.source
    yield "swarm"
    wide = max(len(name) for name in mission.scene.names)
    for agent in mission.scene.agents:
        more = [f"yaw {math.degrees(agent.yaw):g}°"] if agent.yaw else []
        more += [str(agent.uri)] if agent.uri else []
        more += [f"camera {source['swarm'][agent.name]['camera']}"] if agent.camera else []
        yield f"  {agent.name:{wide}}  at {', '.join([value(agent.start), *more])}"
    for name, members in source.get("groups", {}).items():
        yield f"  group {name}: {shortlist(members)}"
    if mission.reserve:
        reserve = mission.reserve
        yield (
            f"  in reserve: {shortlist(reserve['agents'])}, to replace agents below "
            f"{reserve['relieve_below']:g} V; ready above {reserve['ready_above']:g} V; "
            f"climbs to {reserve['height']:g} m"
        )


def _safety(mission: Mission) -> Iterator[str]:
    yield "safety"
    for name, rule in mission.safety.items():
        yield f"  {name}: {RULES[name].format(**rule)}, then {rule['then']}"
    if not mission.safety:
        yield "  no rules"
