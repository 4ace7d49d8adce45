"""Whether a mission's limits, distances, starts and climbs leave room to fly in its world."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any, TypeAlias

from star_core.contracts import MissionSpec
from star_core.errors import PluginError, suggestion
from star_core.mission_file.sound_parts import Incomplete
from star_core.mission_file.step_tree import within
from star_core.plugin_schema import JOIN, RESERVE
from star_core.registry import Registry
from star_core.scene import Scene
from star_core.world.quaternions import Point
from star_core.world.world import CONTACT_RADIUS, Fence

Path: TypeAlias = tuple[str | int, ...]
Fault: TypeAlias = tuple[Path, str]
"""Where in a mission something is wrong, and what."""
Deed: TypeAlias = tuple[str, str, Mapping[str, Any], tuple[int, ...]]
"""Of a step: its place, its verb, the verb's options and the rows of its agents."""


def faults(data: Mapping[str, Any], scene: Scene, registry: Registry) -> Iterator[Fault]:
    """Yield why nothing at all can be flown within the limits, and the path of each reason."""
    yield from _heights(data, scene)
    yield from _distances(data, scene, registry)


def boundless(scene: Scene) -> Scene:
    """Return a scene without limits, to look for faults that do not follow from theirs."""
    limits = replace(scene.limits, height=(-math.inf, math.inf), separation=0.0)
    return replace(scene, limits=limits)


def start_faults(data: Mapping[str, Any], scene: Scene, registry: Registry) -> Iterator[Fault]:
    """Starts where nobody can stand, or that are too near to each other."""
    for agent in scene.agents:
        fault = scene.world.fault(agent.start)
        if fault is not None and "start" in data["swarm"][agent.name]:
            yield ("swarm", agent.name, "start"), f"start {fault}"
    radius, whose = _radius(data["avoider"], registry)
    wide = math.dist(scene.world.fence.low, scene.world.fence.high)
    asked = min(data.get("limits", {}).get("separation", 0.0), scene.limits.separation)
    needed = 2 * radius if 2 * radius <= wide else 0.0
    apart, what = max((needed, f"twice {whose}"), (asked, "limits.separation"))
    for first, second in combinations(scene.agents, 2):
        distance = math.dist(first.start, second.start)
        if distance < apart:
            yield (
                ("swarm", second.name, "start"),
                f"{second.name!r} starts {distance:.2f} m from {first.name!r}, "
                f"closer than {what} ({apart:.2f} m)",
            )


def reserve_faults(data: Mapping[str, Any], scene: Scene) -> Iterator[Fault]:
    """Agents in reserve that are none, voltages that cannot be, and climbs that lead nowhere."""
    reserve = data.get("reserve", {})
    for i, name in enumerate(reserve.get("agents", ())):
        if name not in scene.names:
            yield (
                ("reserve", "agents", i),
                f"no agent named {name!r}{suggestion(name, scene.names, 'there are')}",
            )
    if set(scene.names) <= set(reserve.get("agents", ())):
        yield ("reserve", "agents"), "every agent is in reserve; leave one to be relieved"
    if isinstance(reserve, Incomplete):
        return
    filled = {**RESERVE, **reserve}
    if reserve and (fault := scene.height_fault(filled["height"])):
        yield ("reserve", "height"), fault
    tired, ready = filled["relieve_below"], filled["ready_above"]
    if tired >= ready:
        key = "ready_above" if "ready_above" in reserve else "relieve_below"
        yield (
            ("reserve", key),
            f"a reserve that takes off at ready_above, {ready:g} V, would be relieved at once: "
            f"relieve_below is {tired:g} V",
        )
    for i, name in enumerate(reserve.get("agents", ())):
        if name in scene.names and (
            fault := _climb_fault(scene, scene.names.index(name), filled["height"])
        ):
            yield ("reserve", "agents", i), fault


def climb_faults(
    deeds: Iterable[Deed], reserve: Iterable[int], scene: Scene, registry: Registry
) -> Iterator[str]:
    """Yield which obstacles agents would climb into, with the places of the steps.

    Only the first climb of each agent is looked at, from where it starts: where it takes off again
    is not known before the flight. A verb says that it climbs by what it offers: it is for agents
    on the ground, takes them into the air, and has an option `height`.

    Args:
        deeds: Every step of the mission, in order.
        reserve: Rows of those that only a `join` brings into the mission.
        scene: The mission's scene.
        registry: Where the verbs are offered.
    """
    standing, joining = set(range(len(scene.agents))), set(reserve)
    for place, verb, options, rows in deeds:
        if isinstance(options, Incomplete):  # where its agents are afterwards is not known
            return
        offer = registry.find("task", verb).offer
        here = [row for row in rows if row in standing and (row not in joining or verb == JOIN)]
        height = options.get("height", _default(offer, "height"))
        if (offer.before, offer.after) == ("ground", "air") and isinstance(height, (int, float)):
            for row in here:
                if fault := _climb_fault(scene, row, height):
                    yield f"{place}: {fault}"
        if offer.after not in {"same", "ground"}:
            standing.difference_update(here)


def safety_faults(data: Mapping[str, Any], scene: Scene, registry: Registry) -> Iterator[Fault]:
    """A fence that counts as near wherever one is, where agents start, or where they climb to."""
    rule = data.get("safety", {}).get("fence_near")
    if rule is None or isinstance(rule, Incomplete):
        return
    near, fence = rule.get("within", 0.0), scene.world.fence
    path = ("safety", "fence_near", *["within"] * ("within" in rule))
    narrow = min(high - low for low, high in zip(fence.low, fence.high, strict=True))
    if 2 * near >= narrow:
        yield (
            path,
            f"every place inside the fence is within {near:g} m of it: it is {narrow:g} m wide",
        )
        return
    then = f"safety.fence_near would {rule.get('then', 'land')}"
    for agent in scene.agents:
        room = min(_room(fence, agent.start, 0), _room(fence, agent.start, 1))
        if 0 <= room <= near:
            yield (
                ("swarm", agent.name, "start"),
                f"{agent.name!r} starts {room:.2f} m from a side of the fence, and {then} "
                f"whoever flies within {near:g} m of it",
            )
    (low, high), (floor, ceiling) = scene.limits.height, (fence.low[2], fence.high[2])
    if low < high and max(low, floor + near) >= min(high, ceiling - near):
        yield (
            path,
            f"every height to fly at, from {low:g} to {high:g} m, is within {near:g} m of the "
            f"floor or the ceiling of the fence, at {floor:g} and {ceiling:g} m",
        )
        return
    for place, height in _climbs(data, registry):
        room = _room(fence, (0.0, 0.0, height), 2)
        if 0 <= room <= near and scene.height_fault(height) is None:
            side = "floor" if height - floor <= ceiling - height else "ceiling"
            yield (
                place,
                f"{height:g} m is {room:.2f} m from the {side} of the fence, and {then} whoever "
                f"flies within {near:g} m of it",
            )


def _heights(data: Mapping[str, Any], scene: Scene) -> Iterator[Fault]:
    """Heights that nobody can fly at: a fault of the limits, or of the world if none are given."""
    (low, high), fence = scene.limits.height, scene.world.fence
    path = ("limits", "height") if "height" in data.get("limits", {}) else ("world",)
    if low >= high:
        yield path, f"lowest {low!r} is not below highest {high!r}"
    elif max(low, fence.low[2]) >= min(high, fence.high[2]):
        yield (
            path,
            f"no height to fly at is inside the fence: they are from {low:g} to {high:g} m, "
            f"and the fence from {fence.low[2]:g} to {fence.high[2]:g} m",
        )


def _distances(data: Mapping[str, Any], scene: Scene, registry: Registry) -> Iterator[Fault]:
    """Distances between agents that are wider than the world."""
    fence, swarm = scene.world.fence, len(scene.agents)
    wide = math.dist(fence.low, fence.high)
    (radius, whose), separation = _radius(data["avoider"], registry), scene.limits.separation
    if swarm > 1 and 2 * radius > wide:
        yield (
            ("avoider", "radius"),
            f"twice {whose} ({2 * radius:g} m) is wider than the fence, {wide:.2f} m across",
        )
    if swarm > 1 and separation > wide:
        yield (
            ("limits", "separation"),
            f"a separation of {separation:g} m is wider than the fence, {wide:.2f} m across",
        )


def _climb_fault(scene: Scene, row: int, height: float) -> str | None:
    """Say which obstacle an agent hits that climbs from its start to a height, if it hits one."""
    agent = scene.agents[row]
    if math.isnan(agent.start[0]):  # not known
        return None
    hit = scene.world.overhead(agent.start, height)
    if hit is None or scene.world.contact_fault(agent.start):  # that is told of the start
        return None
    foot, top = hit.height
    return (
        f"{agent.name!r} cannot climb to {height:g} m: obstacle {hit.name!r} is over its start, "
        f"from {foot:g} to {top:g} m"
    )


def _room(fence: Fence, point: Point, axis: int) -> float:
    """How far a point is from the nearer side of a fence along an axis, m; negative beyond it."""
    return min(point[axis] - fence.low[axis], fence.high[axis] - point[axis])


def _climbs(data: Mapping[str, Any], registry: Registry) -> Iterator[tuple[Path, float]]:
    """Heights that the mission has agents climb to, each with its place."""
    for path, verb, given in _actions(data["mission"], ("mission",)):
        if isinstance(given, Incomplete):
            continue
        try:
            offer = registry.find("task", verb).offer
        except PluginError:  # `checks` says so
            continue
        height = given.get("height", _default(offer, "height"))
        if (offer.before, offer.after) == ("ground", "air") and isinstance(height, (int, float)):
            yield (*path, *["height"] * ("height" in given)), height
    reserve = data.get("reserve")
    if reserve and not isinstance(reserve, Incomplete):
        key = ["height"] * ("height" in reserve)
        yield ("reserve", *key), {**RESERVE, **reserve}["height"]


def _actions(
    steps: Iterable[Mapping[str, Any]], path: Path
) -> Iterator[tuple[Path, str, Mapping[str, Any]]]:
    """Yield every step that is a plugin's verb, with its place and its options."""
    for step, place in within(steps, path):
        ((verb, given),) = step.items()
        if verb == "each":
            yield from _actions(given["steps"], (*place, verb, "steps"))
        else:
            yield (*place, verb), verb, given


def _default(offer: MissionSpec, option: str) -> Any:
    """What an offer takes for an option that is not given; None if it does not say."""
    return offer.options.get("properties", {}).get(option, {}).get("default")


def _radius(given: str | Mapping[str, Any], registry: Registry) -> tuple[float, str]:
    """The radius that is kept free around an agent, m: the avoider's option or a drone's own."""
    use, options = (given, {}) if isinstance(given, str) else (given["use"], given)
    if isinstance(given, Incomplete) and "radius" not in given:
        return 0.0, ""
    try:
        usual = _default(registry.find("avoider", use).offer, "radius")
    except PluginError:
        usual = None
    radius = options.get("radius", usual)
    return (CONTACT_RADIUS, "a drone's radius") if radius is None else (radius, "avoider.radius")
