"""A planner that flies the shortest path around, over or under obstacles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from star_core import PlannerSpec, deferred, hookimpl
from star_core.toolkit import number, positive

if TYPE_CHECKING:
    from star_core import Problem, Scene


OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "clearance": number(
            "Horizontal distance to keep to obstacles, m. Goals nearer than this are refused. "
            "Where there is room, it is enlarged for uncertain positions, at most tripled.",
            default=0.2,
            minimum=0,
        ),
        "vertical_clearance": number(
            "Vertical distance to keep to obstacles, m.", default=0.2, minimum=0
        ),
        "margin": number(
            "Distance kept beyond the clearances, m, so that an agent that rounds a corner or "
            "deviates from its path a little still respects them.",
            default=0.05,
            minimum=0.001,
        ),
        "look_ahead": positive(
            "Distance along the path to the point an agent steers to, m: larger rounds corners.",
            default=0.3,
        ),
        "replan_distance": number(
            "A path is replanned when its goal has moved this far, m.", default=0.1, minimum=0
        ),
        "hold_distance": number(
            "An agent whose goal has moved farther than this, m, hovers until its path is planned.",
            default=1.0,
            minimum=0,
        ),
        "queries_per_tick": {
            "type": "integer",
            "minimum": 1,
            "description": "Greatest number of paths planned in one tick; the agents take turns.",
            "default": 16,
        },
        "gain": positive("Speed towards the goal per meter of distance, 1/s.", default=1.5),
        "yaw_rate_deg": positive("Greatest yaw rate, degrees/s.", default=90.0),
    },
}


def check_goals(
    scene: Scene, goals: Sequence[tuple[float, float, float]], **options: Any
) -> Iterator[Problem]:
    from star_core import Problem
    from star_visibility.refusals import refusal

    kept = {name: options[name] for name in ("clearance", "vertical_clearance")}
    for i, goal in enumerate(goals):
        if reason := refusal(scene.world, goal, **kept):
            yield Problem((i,), reason)


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
def star_planners() -> Iterable[PlannerSpec]:
    yield PlannerSpec(
        name="visibility",
        summary="Fly the shortest path around, over or under obstacles.",
        make=deferred("star_visibility.virtual:planner"),
        avoids_obstacles=True,
        options=OPTIONS,
        check=check,
        check_goals=check_goals,
    )
