"""A planner that flies straight to each goal."""

from __future__ import annotations

from collections.abc import Iterable

from star_core import PlannerSpec, deferred, hookimpl
from star_core.toolkit import positive


@hookimpl
def star_planners() -> Iterable[PlannerSpec]:
    yield PlannerSpec(
        name="straight",
        summary="Flies straight to the goal and brakes in time; ignores obstacles.",
        make=deferred("star_straight.planner:Straight"),
        options={
            "type": "object",
            "properties": {
                "gain": positive("Speed towards the goal per meter of distance, 1/s.", default=1.5),
                "yaw_rate_deg": positive("Greatest yaw rate, degrees/s.", default=90.0),
            },
        },
    )
