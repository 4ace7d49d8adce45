"""The area to search: its outline, and whether it is valid."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

from star_core import Problem, outline_fault

if TYPE_CHECKING:
    from star_core import Scene

Corner: TypeAlias = tuple[float, float]
Area: TypeAlias = Sequence[Sequence[float]] | Mapping[str, Sequence[float]]


def area_corners(scene: Scene, area: Area | None) -> tuple[Corner, ...]:
    """Return the corners of the area, m: of a polygon, of a box, or of the fence if None."""
    if area is None:
        fence = scene.world.fence
        area = {"low": fence.low[:2], "high": fence.high[:2]}
    if isinstance(area, Mapping):
        (x, y), (u, v) = area["low"], area["high"]
        return ((x, y), (u, y), (u, v), (x, v))
    return tuple((float(x), float(y)) for x, y in area)


def area_problems(scene: Scene, area: Area | None) -> Iterator[Problem]:
    """Check that an area is inside the fence, and that its outline is a polygon."""
    if area is None:
        return
    low, high = scene.world.fence.low, scene.world.fence.high
    named = area.items() if isinstance(area, Mapping) else enumerate(area)
    for key, (x, y) in named:
        if not (low[0] <= x <= high[0] and low[1] <= y <= high[1]):
            yield Problem(
                ("area", key),
                f"[{x:g}, {y:g}] is outside the fence, from [{low[0]:g}, {low[1]:g}] "
                f"to [{high[0]:g}, {high[1]:g}]",
                "outside-geofence",
            )
    if isinstance(area, Mapping):
        (x, y), (u, v) = area["low"], area["high"]
        if not (x < u and y < v):
            message = f"low {area['low']!r} is not below high {area['high']!r} in x and y"
            yield Problem(("area",), message, "out-of-range")
    elif fault := outline_fault(area_corners(scene, area)):
        message = f"{fault}; give the corners in order around the area"
        yield Problem(("area",), message, "invalid-polygon")
