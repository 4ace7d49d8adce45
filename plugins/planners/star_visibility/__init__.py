"""A planner that flies the shortest way around, over or under obstacles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from star_core import Offer, hookimpl

if TYPE_CHECKING:
    from star_core import Planner, Problem, Scene


def _number(description: str, default: float, **bound: float) -> dict[str, Any]:
    return {"type": "number", "description": description, "default": default, **bound}


OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "clearance": _number(
            "Distance that agents keep beside obstacles, m. A goal nearer than this cannot be "
            "reached.",
            0.2,
            minimum=0,
        ),
        "vertical_clearance": _number(
            "Distance that agents keep above and below obstacles, m.", 0.2, minimum=0
        ),
        "margin": _number(
            "What paths keep beyond the clearances, m, so that an agent that rounds a corner or is "
            "a little off its path keeps them still.",
            0.05,
            minimum=0.001,
        ),
        "look_ahead": _number(
            "How far ahead on its path an agent steers to, m: the more, the rounder the corners.",
            0.3,
            exclusiveMinimum=0,
        ),
        "replan_distance": _number(
            "A path is planned anew when its goal has moved so far, m.", 0.1, minimum=0
        ),
        "hold_distance": _number(
            "An agent whose goal has moved farther than this, m, holds until its path is planned.",
            1.0,
            minimum=0,
        ),
        "queries_per_tick": {
            "type": "integer",
            "minimum": 1,
            "description": "Paths planned in one tick at most; the agents take turns.",
            "default": 16,
        },
        "gain": _number(
            "Speed towards the goal per metre of distance, 1/s.", 1.5, exclusiveMinimum=0
        ),
        "yaw_rate_deg": _number("Greatest yaw rate, degrees/s.", 90.0, exclusiveMinimum=0),
    },
}


def make(scene: Scene, **options: Any) -> Planner:
    from star_visibility.planner import Visibility

    defaults = {name: option["default"] for name, option in OPTIONS["properties"].items()}
    return Visibility(scene, **(defaults | options))


def check(scene: Scene, **_options: Any) -> Iterator[Problem]:
    from star_core import Problem

    (low, high), fence = scene.limits.height, scene.world.fence
    if max(low, fence.low[2]) >= min(high, fence.high[2]):
        yield Problem(
            (),
            f"no height to fly at is inside the fence: from {low:g} to {high:g} m, and the fence "
            f"from {fence.low[2]:g} to {fence.high[2]:g} m",
        )


@hookimpl
def star_planners() -> Iterable[Offer[Planner]]:
    yield Offer(
        name="visibility",
        summary="Fly the shortest way around, over or under obstacles.",
        make=make,
        options=OPTIONS,
        check=check,
    )
