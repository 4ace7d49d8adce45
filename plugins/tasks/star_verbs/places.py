"""Whether an agent can be at a place, or fly so fast. Nothing here imports numpy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from star_core import Problem

if TYPE_CHECKING:
    from star_core import Scene


def fault(scene: Scene, point: Sequence[float]) -> str | None:
    """Say why no agent can fly at `point` (map frame, m), or return None if one can."""
    x, y, z = (float(value) for value in point)
    low, high = scene.limits.height
    if not low <= z <= high:
        return f"[{x:g}, {y:g}, {z:g}] is outside the heights to fly at, from {low:g} to {high:g} m"
    return scene.world.fault((x, y, z))


def rooms(scene: Scene) -> tuple[float, float, float]:
    """Return how far one can fly along x, y and z inside the fence and the heights, m."""
    fence, (low, high) = scene.world.fence, scene.limits.height
    x, y, _ = (b - a for a, b in zip(fence.low, fence.high, strict=True))
    return x, y, min(fence.high[2], high) - max(fence.low[2], low)


def slot_faults(scene: Scene, places: Sequence[Sequence[float]]) -> Iterable[str]:
    """Say of each place that no agent can be at why, and which of the agents' places it is."""
    for number, place in enumerate(places, start=1):
        message = fault(scene, place)
        if message is not None:
            several = len(places) > 1
            yield f"place {number} of {len(places)}: {message}" if several else message


def too_fast(scene: Scene, options: Mapping[str, Any], *path: str) -> Iterator[Problem]:
    """Say that the option ``speed``, which stands at `path`, is above what an agent may fly."""
    most = scene.limits.speed
    if options.get("speed", 0.0) > most:
        yield Problem(
            (*path, "speed"), f"{options['speed']:g} m/s is above limits.speed, {most:g} m/s"
        )
