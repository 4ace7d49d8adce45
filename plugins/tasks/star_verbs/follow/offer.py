"""The options of ``follow``, as JSON Schema, and the factory of its task."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from star_core import TaskSpec
from star_verbs.follow.checks import check, goals
from star_verbs.quantities import SPACING, point, positive

if TYPE_CHECKING:
    from star_core import Scene, Task


def _make(  # noqa: PLR0913 -- a mission's own options
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
    from star_verbs.follow.follow import Follow
    from star_verbs.follow.ways import along_route, in_its_own_time

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


OFFER: TaskSpec = TaskSpec(
    name="follow",
    before="air",
    after="air",
    summary="Fly along a path: a box, a circle, a figure 8, or points from a file.",
    make=_make,
    check=check,
    goals=goals,
    options={
        "type": "object",
        "properties": {
            "file": {
                "type": "string",
                "description": "CSV file in the mission's folder, in the given 'format'. Give "
                "this or 'path'.",
                "examples": ["paths/inspection.csv"],
            },
            "format": {
                "enum": ["waypoints", "poly7"],
                "description": "Format of the file. waypoints: columns x, y, z in the map, m, and "
                "optionally yaw_deg, degrees. poly7: Crazyswarm2's duration, s, and polynomials of "
                "7th degree for x, y, z, m, and yaw, rad, flown in the file's own time.",
                "default": "waypoints",
            },
            "timescale": positive(
                "Factor by which the duration of a poly7 file is stretched: 2 is half as fast.",
                default=1.0,
            ),
            "relative": {
                "type": "boolean",
                "description": "Whether a poly7 file begins at each agent's position, shifted and "
                "not rotated; false: it is in the map frame.",
                "default": True,
            },
            "on_board": {
                "type": "boolean",
                "description": "Whether a poly7 file is uploaded to each agent before take-off and "
                "flown by its own commander: exactly in time, not steered by planner or avoider "
                "until it ends. Other agents still give way.",
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
                "Size of the path along y, m; by default the size, half of it for the figure 8.",
                examples=[1.2],
            ),
            "centre": point(
                "Center of the path, [x, y, z] in the map, m. Needed with 'path'.",
                [0.0, 0.0, 0.8],
            ),
            "laps": {
                "type": "integer",
                "minimum": 1,
                "description": "Number of laps; with 'path' only.",
                "default": 1,
            },
            "heading": {
                "enum": ["fixed", "along"],
                "description": "Look along the path, or keep the heading (or fly the file's "
                "yaw_deg).",
                "default": "fixed",
            },
            "speed": positive("Speed along the path, m/s; at most limits.speed.", default=0.3),
            "spacing": SPACING,
        },
        "examples": [{"path": "circle", "size": 2.0, "centre": [0.0, 0.0, 0.8]}],
    },
)
