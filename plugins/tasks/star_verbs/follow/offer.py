"""What ``follow`` takes, as JSON Schema, and how its task is made."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from star_core import Offer
from star_verbs.follow.checks import check
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


OFFER: Offer[Task] = Offer(
    name="follow",
    before="air",
    after="air",
    summary="Fly along a path: a box, a circle, a figure 8, or points from a file.",
    make=_make,
    check=check,
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
            "spacing": SPACING,
        },
        "examples": [{"path": "circle", "size": 2.0, "centre": [0.0, 0.0, 0.8]}],
    },
)
