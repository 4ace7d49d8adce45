"""What each verb takes, as JSON Schema, and how its task is made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from star_core import Offer
from star_verbs import checks
from star_verbs.formation.offer import OFFER as FORMATION
from star_verbs.quantities import point, positive

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


def _follow(  # noqa: PLR0913 -- a mission's own options
    scene: Scene,
    rows: tuple[int, ...],
    *,
    speed: float = 0.3,
    heading: str = "fixed",
    spacing: float = 0.6,
    laps: int = 1,
    format: str = "waypoints",  # noqa: A002 -- the mission's own word
    timescale: float = 1.0,
    relative: bool = True,
    on_board: bool = False,
    **source: Any,
) -> Task:
    from star_verbs.follow import Follow
    from star_verbs.ways import along_route, in_its_own_time

    if format == "poly7":
        way = in_its_own_time(
            scene,
            len(rows),
            spacing,
            source["file"],
            timescale=timescale,
            relative=relative,
            on_board=on_board,
        )
    else:
        way = along_route(scene, len(rows), speed, spacing=spacing, laps=laps, **source)
    return Follow(scene, rows, way, along=heading == "along")


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
    "Greatest speed on the way, m/s; limits.speed at most and if not given.", examples=[0.3]
)
_YAW = {
    "type": "number",
    "description": "Heading to turn to, degrees anticlockwise from the map's x axis; "
    "each agent keeps its own if not given.",
    "examples": [90],
}
_SPACING = positive(
    "Least distance between the agents where several are sent to one place, m.", default=0.6
)

OFFERS: tuple[Offer[Task], ...] = (
    Offer(
        name="takeoff",
        before="ground",
        after="air",
        summary="Climb straight up and hold there.",
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
    Offer(
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
    Offer(
        name="hold",
        after="same",
        summary="Stay in one place for a time.",
        make=_hold,
        check=checks.hold,
        options={
            "type": "object",
            "properties": {
                "for": {
                    "type": "number",
                    "minimum": 0,
                    "description": "How long to stay, counted from arrival, s.",
                    "default": 0.0,
                    "examples": [5],
                },
                "at": point(
                    "Where to stay, [x, y, z] in the map, m; several agents spread around it; "
                    "each agent stays where it is if not given.",
                    [0.0, 0.0, 1.2],
                ),
                "yaw_deg": _YAW,
                "speed": _TRAVEL_SPEED,
                "spacing": _SPACING,
            },
            "examples": [{"for": 5}],
        },
    ),
    Offer(
        name="join",
        before="ground",
        after="air",
        summary="Take off from reserve, and be in the mission from then on; needs 'agents', "
        "except in 'each'.",
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
                    "description": "Voltage on the ground that each agent needs, V.",
                    "default": 3.8,
                },
            },
            "examples": [{"agents": "cf3", "height": 0.8}],
        },
    ),
    Offer(
        name="leave",
        before="air",
        after="ground",
        summary="Fly to where one started, land, and be in the mission no more.",
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
    Offer(
        name="wait",
        after="same",
        summary="Stay where everybody is until a condition holds; for 60 s at most if not said.",
        make=_wait,
        options={
            "type": "object",
            "required": ["until"],
            "properties": {},
            "examples": [{"until": {"elapsed": 10}}],
        },
    ),
    Offer(
        name="goto",
        before="air",
        after="air",
        summary="Fly to a point, or by an offset, and stop there.",
        make=_goto,
        check=checks.goto,
        options={
            "type": "object",
            "properties": {
                "to": point(
                    "Where to, [x, y, z] in the map, m; several agents spread around it. "
                    "Give this or 'by'.",
                    [1.0, 0.5, 0.8],
                ),
                "by": point(
                    "How far from where each agent is, [x, y, z] along the map's axes, m. "
                    "Give this or 'to'.",
                    [0.5, 0.0, 0.0],
                ),
                "yaw_deg": _YAW,
                "speed": _TRAVEL_SPEED,
                "spacing": _SPACING,
                "within": positive("How near to its goal each agent must come, m.", default=0.1),
            },
            "examples": [{"agents": "cf1", "to": [1.0, 0.5, 0.8]}],
        },
    ),
    Offer(
        name="follow",
        before="air",
        after="air",
        summary="Fly along a path: a box, a circle, a figure 8, or points from a file.",
        make=_follow,
        check=checks.follow,
        options={
            "type": "object",
            "properties": {
                "file": {
                    "type": "string",
                    "description": "CSV file in the mission's folder, of the 'format' said. Give "
                    "this or 'path'.",
                    "examples": ["paths/inspection.csv"],
                },
                "format": {
                    "enum": ["waypoints", "poly7"],
                    "description": "Of the file. waypoints: columns x, y, z in the map, m, and if "
                    "wanted yaw_deg, degrees. poly7: Crazyswarm2's duration, s, and polynomials of "
                    "7th degree for x, y, z, m, and yaw, rad, flown in the file's own time.",
                    "default": "waypoints",
                },
                "timescale": positive(
                    "How many times its own time a poly7 file is flown in: 2 is half as fast.",
                    default=1.0,
                ),
                "relative": {
                    "type": "boolean",
                    "description": "Whether a poly7 file begins where each agent is, shifted and "
                    "not turned; false: it lies in the map.",
                    "default": True,
                },
                "on_board": {
                    "type": "boolean",
                    "description": "Whether each agent is sent a poly7 file before take-off and "
                    "flies it by its own commander: exactly in its time, steered by neither "
                    "planner nor avoider until it is over. Others still make way.",
                    "default": False,
                },
                "path": {
                    "enum": ["box", "circle", "figure8"],
                    "description": "A closed path; the figure 8 is a lemniscate of Gerono along x. "
                    "Give this or 'file'.",
                    "examples": ["circle"],
                },
                "size": positive(
                    "Side of the box, diameter of the circle, length of the figure 8 along x, m. "
                    "Needed with 'path'.",
                    examples=[2.4],
                ),
                "width": positive(
                    "Of the path along y, m; the size if not given, half of it for the figure 8.",
                    examples=[1.2],
                ),
                "centre": point(
                    "Middle of the path, [x, y, z] in the map, m. Needed with 'path'.",
                    [0.0, 0.0, 0.8],
                ),
                "laps": {
                    "type": "integer",
                    "minimum": 1,
                    "description": "How many times round; with 'path' only.",
                    "default": 1,
                },
                "heading": {
                    "enum": ["fixed", "along"],
                    "description": "Look along the path, or keep the heading (or fly the file's "
                    "yaw_deg).",
                    "default": "fixed",
                },
                "speed": positive("Speed along the path, m/s; limits.speed at most.", default=0.3),
                "spacing": _SPACING,
            },
            "examples": [{"path": "circle", "size": 2.0, "centre": [0.0, 0.0, 0.8]}],
        },
    ),
    FORMATION,
)
