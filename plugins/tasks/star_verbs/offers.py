"""The options of each verb, as JSON Schema, and the factory of its task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from star_core import TaskSpec
from star_verbs import checks
from star_verbs.follow.offer import OFFER as FOLLOW
from star_verbs.formation.offer import OFFER as FORMATION
from star_verbs.quantities import SPACING, point, positive

if TYPE_CHECKING:
    from star_core import Scene, Task


def _takeoff(
    scene: Scene, rows: tuple[int, ...], *, height: float = 0.8, speed: float = 0.3
) -> Task:
    from star_verbs.takeoff import Takeoff

    return Takeoff(scene, rows, height=height, speed=speed)


def _land(scene: Scene, rows: tuple[int, ...], *, speed: float = 0.2) -> Task:
    from star_verbs.land import Land

    return Land(scene, rows, speed=speed)


def _hold(
    scene: Scene,
    rows: tuple[int, ...],
    *,
    at: Sequence[float] | None = None,
    yaw_deg: float | None = None,
    speed: float | None = None,
    spacing: float = 0.6,
    **also: float,
) -> Task:
    from star_verbs.approach import Approach
    from star_verbs.hold import Hold

    approach = Approach(scene, rows, speed=speed, yaw_deg=yaw_deg, within=0.1)
    return Hold(approach, at=at, spacing=spacing, seconds=also.get("for", 0.0))


def _goto(
    scene: Scene,
    rows: tuple[int, ...],
    *,
    to: Sequence[float] | None = None,
    by: Sequence[float] | None = None,
    yaw_deg: float | None = None,
    speed: float | None = None,
    spacing: float = 0.6,
    within: float = 0.1,
) -> Task:
    from star_verbs.approach import Approach
    from star_verbs.goto import Goto

    approach = Approach(scene, rows, speed=speed, yaw_deg=yaw_deg, within=within)
    return Goto(approach, to=to, by=by, spacing=spacing)


def _join(
    scene: Scene,
    rows: tuple[int, ...],
    *,
    height: float = 0.8,
    speed: float = 0.3,
    battery: float = 3.8,
) -> Task:
    from star_verbs.join import Join

    return Join(scene, rows, height=height, speed=speed, battery=battery)


def _leave(
    scene: Scene, rows: tuple[int, ...], *, speed: float | None = None, descent: float = 0.2
) -> Task:
    from star_verbs.leave import Leave

    return Leave(scene, rows, speed=speed, descent=descent)


def _wait(_scene: Scene, _rows: tuple[int, ...]) -> Task:
    from star_verbs.wait import Wait

    return Wait()


_TRAVEL_SPEED = positive(
    "Speed limit on the way, m/s; at most limits.speed, and that if not given.", examples=[0.3]
)
_YAW = {
    "type": "number",
    "description": "Heading to turn to, degrees anticlockwise from the map's x axis; "
    "each agent keeps its own if not given.",
    "examples": [90],
}
OFFERS: tuple[TaskSpec, ...] = (
    TaskSpec(
        name="takeoff",
        before="ground",
        after="air",
        summary="Climb straight up and hover there.",
        make=_takeoff,
        check=checks.takeoff,
        options={
            "type": "object",
            "properties": {
                "height": positive("Height to climb to, z in the map, m.", default=0.8),
                "speed": positive("Mean speed of the climb, m/s.", default=0.3),
            },
            "examples": [{"height": 0.8}],
        },
    ),
    TaskSpec(
        name="land",
        after="ground",
        summary="Descend straight down and stop the motors.",
        make=_land,
        options={
            "type": "object",
            "properties": {"speed": positive("Mean speed of the descent, m/s.", default=0.2)},
            "examples": [{}],
        },
    ),
    TaskSpec(
        name="hold",
        after="same",
        summary="Hover in place for a time.",
        make=_hold,
        check=checks.hold,
        goals=checks.hold_goals,
        options={
            "type": "object",
            "properties": {
                "for": {
                    "type": "number",
                    "minimum": 0,
                    "description": "Duration, counted from arrival, s.",
                    "default": 0.0,
                    "examples": [5],
                },
                "at": point(
                    "Where to hover, [x, y, z] in the map, m; several agents spread around it; "
                    "each agent stays in place if not given.",
                    [0.0, 0.0, 1.2],
                ),
                "yaw_deg": _YAW,
                "speed": _TRAVEL_SPEED,
                "spacing": SPACING,
            },
            "examples": [{"for": 5}],
        },
    ),
    TaskSpec(
        name="join",
        before="ground",
        after="air",
        summary="Take off from reserve and take part in the mission from then on; needs "
        "'agents', except in 'each'.",
        make=_join,
        check=checks.takeoff,
        options={
            "type": "object",
            "properties": {
                "height": positive("Height to climb to, z in the map, m.", default=0.8),
                "speed": positive("Mean speed of the climb, m/s.", default=0.3),
                "battery": {
                    "type": "number",
                    "minimum": 0,
                    "maximum": 17,
                    "description": "Battery voltage on the ground that each agent needs, V.",
                    "default": 3.8,
                },
            },
            "examples": [{"agents": "cf3", "height": 0.8}],
        },
    ),
    TaskSpec(
        name="leave",
        before="air",
        after="ground",
        summary="Fly back to the start, land, and leave the mission.",
        make=_leave,
        check=checks.leave,
        options={
            "type": "object",
            "properties": {
                "speed": _TRAVEL_SPEED,
                "descent": positive("Mean speed of the descent, m/s.", default=0.2),
            },
            "examples": [{"agents": "cf1"}],
        },
    ),
    TaskSpec(
        name="wait",
        after="same",
        summary="Hover until a condition holds; the default timeout is 60 s.",
        make=_wait,
        options={
            "type": "object",
            "required": ["until"],
            "properties": {},
            "examples": [{"until": {"elapsed": 10}}],
        },
    ),
    TaskSpec(
        name="goto",
        before="air",
        after="air",
        summary="Fly to a point, or by an offset, and stop there.",
        make=_goto,
        check=checks.goto,
        goals=checks.goto_goals,
        options={
            "type": "object",
            "properties": {
                "to": point(
                    "Goal, [x, y, z] in the map, m; several agents spread around it. "
                    "Give this or 'by'.",
                    [1.0, 0.5, 0.8],
                ),
                "by": point(
                    "Offset from each agent's position, [x, y, z] along the map's axes, m. "
                    "Give this or 'to'.",
                    [0.5, 0.0, 0.0],
                ),
                "yaw_deg": _YAW,
                "speed": _TRAVEL_SPEED,
                "spacing": SPACING,
                "within": positive("Distance to its goal each agent must reach, m.", default=0.1),
            },
            "examples": [{"agents": "cf1", "to": [1.0, 0.5, 0.8]}],
        },
    ),
    FOLLOW,
    FORMATION,
)
