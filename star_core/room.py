"""Whether a mission's limits, distances and starts leave room to fly in its world."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any, Final, TypeAlias

from star_core.errors import PluginError
from star_core.registry import Registry
from star_core.scene import Scene

CONTACT_RADIUS: Final = 0.06
"""Half a Crazyflie's span with propellers, m: two drones nearer than twice this collide."""

Path: TypeAlias = tuple[str | int, ...]
Fault: TypeAlias = tuple[Path, str]
"""Where in a mission something is wrong, and what."""


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
        if fault := scene.world.fault(agent.start):
            yield ("swarm", agent.name, "start"), f"start {fault}"
    radii = 2 * _radius(data["avoider"], registry)
    wide = math.dist(scene.world.fence.low, scene.world.fence.high)
    asked = min(data.get("limits", {}).get("separation", 0.0), scene.limits.separation)
    apart, what = max((radii if radii <= wide else 0.0, "two radii"), (asked, "limits.separation"))
    for first, second in combinations(scene.agents, 2):
        distance = math.dist(first.start, second.start)
        if distance < apart:
            yield (
                ("swarm", second.name, "start"),
                f"{second.name!r} starts {distance:.2f} m from {first.name!r}, "
                f"expected at least {what}: {apart:.2f} m",
            )


def safety_faults(data: Mapping[str, Any], scene: Scene) -> Iterator[Fault]:
    """A fence that counts as near wherever one is."""
    within = data.get("safety", {}).get("fence_near", {}).get("within", 0.0)
    fence = scene.world.fence
    narrow = min(high - low for low, high in zip(fence.low, fence.high, strict=True))
    if 2 * within >= narrow:
        yield (
            ("safety", "fence_near", "within"),
            f"every place inside the fence is within {within:g} m of it: it is {narrow:g} m wide",
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
    radius, separation = _radius(data["avoider"], registry), scene.limits.separation
    if swarm > 1 and 2 * radius > wide:
        yield (
            ("avoider", "radius"),
            f"two radii of {radius:g} m are wider than the fence, {wide:.2f} m across",
        )
    if swarm > 1 and separation > wide:
        yield (
            ("limits", "separation"),
            f"a separation of {separation:g} m is wider than the fence, {wide:.2f} m across",
        )


def _radius(given: str | Mapping[str, Any], registry: Registry) -> float:
    """The radius that the avoider keeps free around an agent: its option of that name, if any."""
    use, options = (given, {}) if isinstance(given, str) else (given["use"], given)
    try:
        known = registry.find("avoider", use).offer.options.get("properties", {})
    except PluginError:
        known = {}
    return float(options.get("radius", known.get("radius", {}).get("default", CONTACT_RADIUS)))
