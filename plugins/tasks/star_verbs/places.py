"""Whether an agent can be at a position, or fly at a speed. Does not import numpy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from star_core import Problem

if TYPE_CHECKING:
    from star_core import Scene


def fault(scene: Scene, point: Sequence[float]) -> str | None:
    """Return why no agent can fly at `point` (map frame, m); None if one can."""
    x, y, z = (float(value) for value in point)
    low, high = scene.limits.height
    if not low <= z <= high:
        return f"[{x:g}, {y:g}, {z:g}] is outside the heights to fly at, from {low:g} to {high:g} m"
    return scene.world.fault((x, y, z))


def rooms(scene: Scene) -> tuple[float, float, float]:
    """Return the extent of the fence and the flight heights along x, y and z, m."""
    fence, (low, high) = scene.world.fence, scene.limits.height
    x, y, _ = (b - a for a, b in zip(fence.low, fence.high, strict=True))
    return x, y, min(fence.high[2], high) - max(fence.low[2], low)


def slot_faults(scene: Scene, places: Sequence[Sequence[float]]) -> Iterable[str]:
    """Report positions that are not flyable, why, and their numbers."""
    for number, place in enumerate(places, start=1):
        message = fault(scene, place)
        if message is not None:
            several = len(places) > 1
            yield f"place {number} of {len(places)}: {message}" if several else message


def too_fast(scene: Scene, options: Mapping[str, Any], *path: str) -> Iterator[Problem]:
    """Report that the option ``speed``, at `path`, exceeds the speed limit."""
    most = scene.limits.speed
    if options.get("speed", 0.0) > most:
        yield Problem(
            (*path, "speed"), f"{options['speed']:g} m/s is above limits.speed, {most:g} m/s"
        )
