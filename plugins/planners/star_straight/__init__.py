"""A planner that flies straight to each goal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from star_core import PlannerSpec, hookimpl

if TYPE_CHECKING:
    from star_core import Planner, Scene


def make(scene: Scene, **options: float) -> Planner:
    from star_straight.planner import Straight

    return Straight(scene, **options)


@hookimpl
def star_planners() -> Iterable[PlannerSpec]:
    yield PlannerSpec(
        name="straight",
        summary="Flies straight to the goal and brakes in time; ignores obstacles.",
        make=make,
        avoids_obstacles=False,
        options={
            "type": "object",
            "properties": {
                "gain": {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "description": "Speed towards the goal per meter of distance, 1/s.",
                    "default": 1.5,
                },
                "yaw_rate_deg": {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "description": "Greatest yaw rate, degrees/s.",
                    "default": 90.0,
                },
            },
        },
    )
