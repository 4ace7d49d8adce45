"""The verbs: their options as JSON Schema, their checks, and the factories of their tasks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from star_core import Problem, TaskSpec, deferred
from star_core.formats import MAX_LISTED
from star_core.toolkit import number, suggestion
from star_verbs.follow.spec import SPEC as FOLLOW
from star_verbs.formation.spec import SPEC as FORMATION
from star_verbs.positions import (
    SPACING,
    TRAVEL_SPEED,
    bounded,
    duration,
    exactly_one,
    extents,
    point,
    speed_problems,
    spread_goals,
    spread_problems,
)

if TYPE_CHECKING:
    from star_core import Scene


def _check_takeoff(
    scene: Scene, _rows: tuple[int, ...], *, height: float, **_options: Any
) -> Iterator[Problem]:
    if fault := scene.height_fault(height):
        yield Problem(("height",), fault, "outside-geofence")


def _check_leave(scene: Scene, _rows: tuple[int, ...], **options: Any) -> Iterator[Problem]:
    yield from speed_problems(scene, options)


def _check_hold(scene: Scene, rows: tuple[int, ...], **options: Any) -> Iterator[Problem]:
    yield from speed_problems(scene, options)
    if "by" in options and "relative_to" not in options:
        yield Problem(("by",), "'by' goes with 'relative_to', which is missing", "missing-option")
    yield from _relative_problems(scene, rows, "at", options)
    yield from spread_problems(scene, rows, key="at", **options)


def _check_goto(scene: Scene, rows: tuple[int, ...], **options: Any) -> Iterator[Problem]:
    yield from speed_problems(scene, options)
    yield from exactly_one("to", "by", options)
    yield from _relative_problems(scene, rows, "to", options)
    yield from spread_problems(scene, rows, key="to", **options)
    offset = options.get("by", (0.0, 0.0, 0.0))
    for axis, by, extent in zip("xyz", offset, extents(scene), strict=True):
        if abs(by) > extent:  # wherever it begins
            where = "the heights to fly at are" if axis == "z" else "the fence is"
            message = f"{abs(by):g} m along {axis}, where {where} only {extent:g} m"
            yield Problem(("by",), message, "unreachable-goal")


def _relative_problems(
    scene: Scene, rows: tuple[int, ...], point: str, options: Mapping[str, Any]
) -> Iterator[Problem]:
    """Check a goal beside another agent; `point` is the option for one in the map."""
    other = options.get("relative_to")
    if other is None:
        if options.get("moving"):
            message = "'moving' goes with 'relative_to', which is missing"
            yield Problem(("moving",), message, "missing-option")
        return
    if point in options:
        message = f"{point!r} does not go with 'relative_to', write 'by'"
        yield Problem((point,), message, "option-conflict")
    elif "by" not in options:
        message = "'relative_to' goes with 'by', which is missing"
        yield Problem(("relative_to",), message, "missing-option")
    if other not in scene.names:
        hint = suggestion(other, scene.names, "there are", MAX_LISTED)
        yield Problem(("relative_to",), f"no agent named {other!r}{hint}", "unknown-agent")
    elif scene.names.index(other) in rows:
        message = f"{other!r} is an agent of this step; name another, or other agents"
        yield Problem(("relative_to",), message, "agent-conflict")
    if "by" in options and (limits := scene.limits).separation > 0:
        x, y, z = options["by"]
        if math.hypot(x, y) / limits.separation < 1 and abs(z) < limits.vertical_separation:
            away = math.hypot(x, y, z)
            message = (
                f"{away:.2f} m from {other!r}; agents keep {limits.separation:g} m from each "
                f"other, and {limits.vertical_separation:g} m above each other"
            )
            yield Problem(("by",), message, "too-close")


_CLIMB_HEIGHT = bounded("Height to climb to, z in the map, m.", default=0.8)
_CLIMB_SPEED = bounded("Mean speed of the climb, m/s.", default=0.3)
_DESCENT_SPEED = bounded("Mean speed of the descent, m/s.", default=0.2)
_YAW = {
    "type": "number",
    "description": "Heading to turn to, degrees anticlockwise from the map's x axis; "
    "each agent keeps its own if not given.",
    "examples": [90],
}
_RELATIVE_TO = {
    "type": "string",
    "description": "Another agent, from whose position 'by' is counted; several agents spread "
    "around that point. If not given, 'by' is counted from each agent's own.",
    "examples": ["cf1"],
}
_MOVING = {
    "type": "boolean",
    "description": "Whether the goal moves with the agent of 'relative_to'; if false or not given, "
    "it is that at the start of the step.",
}
COLORS: Final = {
    "off": "#000000",
    "white": "#ffffff",
    "red": "#ff0000",
    "orange": "#ff8000",
    "yellow": "#ffff00",
    "green": "#00ff00",
    "cyan": "#00ffff",
    "blue": "#0000ff",
    "magenta": "#ff00ff",
}
"""Colors by name, as ``#rrggbb``."""
SPECS: Final[tuple[TaskSpec, ...]] = (
    TaskSpec(
        name="takeoff",
        before="ground",
        after="air",
        summary="Climb straight up and hover there.",
        make=deferred("star_verbs.takeoff:Takeoff"),
        check=_check_takeoff,
        options={
            "type": "object",
            "properties": {"height": _CLIMB_HEIGHT, "speed": _CLIMB_SPEED},
            "examples": [{"height": 0.8}],
        },
    ),
    TaskSpec(
        name="land",
        after="ground",
        summary="Descend straight down and stop the motors.",
        make=deferred("star_verbs.land:Land"),
        options={
            "type": "object",
            "properties": {"speed": _DESCENT_SPEED},
            "examples": [{}],
        },
    ),
    TaskSpec(
        name="hold",
        after="same",
        summary="Hover for a time.",
        make=deferred("star_verbs.goto:Hold"),
        check=_check_hold,
        goals=partial(spread_goals, key="at"),
        options={
            "type": "object",
            "properties": {
                "for": duration("Duration, counted from arrival, s."),
                "at": point(
                    "Where to hover, [x, y, z] in the map, m; several agents spread around it; "
                    "each agent stays at its position if not given.",
                    [0.0, 0.0, 1.2],
                ),
                "by": point(
                    "Offset from the agent of 'relative_to', [x, y, z] along the map's axes, m; "
                    "none if not given.",
                    [-0.6, 0.0, 0.0],
                ),
                "relative_to": _RELATIVE_TO,
                "moving": _MOVING,
                "yaw_deg": _YAW,
                "speed": TRAVEL_SPEED,
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
        make=deferred("star_verbs.takeoff:Join"),
        check=_check_takeoff,
        options={
            "type": "object",
            "properties": {
                "height": _CLIMB_HEIGHT,
                "speed": _CLIMB_SPEED,
                "battery": number(
                    "Battery voltage on the ground that each agent needs, V.",
                    minimum=0,
                    maximum=17,
                    default=3.8,
                ),
            },
            "examples": [{"agents": "cf3", "height": 0.8}],
        },
    ),
    TaskSpec(
        name="leave",
        before="air",
        after="ground",
        summary="Fly back to the start, land, and leave the mission.",
        make=deferred("star_verbs.land:Leave"),
        check=_check_leave,
        options={
            "type": "object",
            "properties": {"speed": TRAVEL_SPEED, "descent": _DESCENT_SPEED},
            "examples": [{"agents": "cf1"}],
        },
    ),
    TaskSpec(
        name="wait",
        after="same",
        summary="Hover until a condition holds; the default timeout is 60 s.",
        make=deferred("star_verbs.goto:Wait"),
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
        make=deferred("star_verbs.goto:Goto"),
        check=_check_goto,
        goals=partial(spread_goals, key="to"),
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
                "relative_to": _RELATIVE_TO,
                "moving": _MOVING,
                "yaw_deg": _YAW,
                "speed": TRAVEL_SPEED,
                "spacing": SPACING,
                "within": bounded("Distance to its goal each agent must reach, m.", default=0.1),
            },
            "examples": [{"agents": "cf1", "to": [1.0, 0.5, 0.8]}],
        },
    ),
    FOLLOW,
    FORMATION,
    TaskSpec(
        name="light",
        after="same",
        summary="Set the color of the drones' light decks.",
        make=deferred("star_verbs.light:Light"),
        options={
            "type": "object",
            "required": ["color"],
            "properties": {
                "color": {
                    "type": "string",
                    "pattern": f"^(#[0-9A-Fa-f]{{6}}|{'|'.join(COLORS)})$",
                    "patternErrorMessage": f"expected '#rrggbb' or one of {', '.join(COLORS)}",
                    "description": f"Color: {', '.join(COLORS)}, or '#rrggbb' in quotes.",
                    "examples": ["red"],
                },
            },
            "examples": [{"color": "red"}],
        },
    ),
)
