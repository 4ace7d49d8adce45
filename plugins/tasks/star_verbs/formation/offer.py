"""The options of ``formation``, as JSON Schema, and the factory of its task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from star_core import TaskSpec
from star_verbs.formation.checks import check, goals
from star_verbs.formation.shapes import SPACING
from star_verbs.quantities import point, positive

if TYPE_CHECKING:
    from star_core import Scene, Task

MOST: Final = 100
"""Greatest number of rows, of columns and of points."""

PACE: Final = 0.3
"""Default speed of a moving formation, m/s."""


def make(
    scene: Scene,
    rows: tuple[int, ...],
    /,  # `rows` is an option of the grid too
    *,
    speed: float | None = None,
    within: float = 0.1,
    yaw_deg: float | None = None,
    move: Mapping[str, Any] | None = None,
    **options: Any,
) -> Task:
    import math

    from star_verbs.formation.formation import Formation, Manner
    from star_verbs.formation.shapes import shape

    also = {"yaw_deg": yaw_deg, "move": move}
    given = options | {key: value for key, value in also.items() if value is not None}
    manner = Manner(
        speed=min(speed or math.inf, scene.limits.speed),
        pace=min((move or {}).get("speed", PACE), scene.limits.speed),
        yaw=None if yaw_deg is None else math.radians(yaw_deg),
        within=within,
        hold=options.get("for", 0.0),
    )
    return Formation(scene, rows, shape(len(rows), given), manner)


def _many(description: str) -> Mapping[str, Any]:
    return {
        "type": "integer",
        "minimum": 1,
        "maximum": MOST,
        "description": description,
        "examples": [2],
    }


OFFER: Final[TaskSpec] = TaskSpec(
    name="formation",
    before="air",
    after="air",
    summary="Form a line, a grid, a circle or points, hold it, and move it as a whole.",
    make=make,
    check=check,
    goals=goals,
    options={
        "type": "object",
        "required": ["shape"],
        "properties": {
            "shape": {
                "enum": ["line", "grid", "circle", "points"],
                "description": "Shape to form; agents are assigned to its positions so that the "
                "total distance flown is minimal. A line lies along x, a grid has its columns "
                "along x, and a circle begins at its greatest x, before they are rotated.",
            },
            "centre": point(
                "Center of the formation, [x, y, z] in the map, m. The default for 'points' is "
                "the map's origin.",
                [0.0, 0.0, 0.8],
            ),
            "spacing": positive(
                f"Distance between neighbours, m; {SPACING:g} by default. For a circle 'radius' "
                "may be given instead.",
                examples=[0.6],
            ),
            "radius": positive("Radius of the circle, m. Give this or 'spacing'.", examples=[0.8]),
            "rows": _many("Rows of the grid; by default as many as its columns need."),
            "columns": _many("Columns of the grid; by default as square as possible."),
            "points": {
                "type": "array",
                "minItems": 1,
                "maxItems": MOST,
                "items": point("Position, [x, y, z] from the center, m.", [0.5, 0.0, 0.0]),
                "description": "Positions relative to the center, m, needed for 'points'; if there "
                "are more positions than agents, some stay empty.",
                "examples": [[[0.0, 0.0, 0.8], [0.6, 0.0, 1.0]]],
            },
            "yaw_deg": {
                "type": "number",
                "description": "Angle by which to rotate the formation, and heading of its agents, "
                "degrees anticlockwise from the map's x axis; if not given, it is not rotated, and "
                "each agent keeps its own heading.",
                "examples": [90],
            },
            "speed": positive(
                "Greatest speed on the way to the places, m/s; limits.speed at most and if not "
                "given.",
                examples=[0.3],
            ),
            "within": positive("Distance to its position each agent must reach, m.", default=0.1),
            "for": {
                "type": "number",
                "minimum": 0,
                "description": "Time to hold the formation once it is formed, s.",
                "default": 0.0,
                "examples": [5],
            },
            "move": {
                "type": "object",
                "description": "Where to move the formation as one after that; nowhere if not "
                "given.",
                "examples": [{"to": [1.0, 0.0, 0.8]}],
                "required": ["to"],
                "additionalProperties": False,
                "properties": {
                    "to": point("Goal of its center, [x, y, z] in the map, m.", [1.0, 0.0, 0.8]),
                    "speed": positive("Of the center, m/s; at most limits.speed.", default=PACE),
                },
            },
        },
        "examples": [{"shape": "line", "centre": [0.0, 0.0, 0.8], "spacing": 0.6}],
    },
)
