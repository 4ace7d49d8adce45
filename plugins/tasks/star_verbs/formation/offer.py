"""What ``formation`` takes, as JSON Schema, and how its task is made."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from star_core import Offer
from star_verbs.formation.checks import check
from star_verbs.formation.shapes import SPACING
from star_verbs.quantities import point, positive

if TYPE_CHECKING:
    from star_core import Scene, Task

MOST: Final = 100
"""Greatest number of rows, of columns and of points that can be given."""

PACE: Final = 0.3
"""Speed of a formation that moves if the mission does not say, m/s."""


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


OFFER: Final[Offer[Task]] = Offer(
    name="formation",
    before="air",
    after="air",
    summary="Form a line, a grid, a circle or points, hold it, and move it as one.",
    make=make,
    check=check,
    options={
        "type": "object",
        "required": ["shape"],
        "properties": {
            "shape": {
                "enum": ["line", "grid", "circle", "points"],
                "description": "What to form; each agent takes the place with which the distances "
                "that all of them fly add up to least. A line lies along x, a grid has its columns "
                "along x, and a circle begins at its greatest x, before they are turned.",
            },
            "centre": point(
                "Middle of the formation, [x, y, z] in the map, m. For 'points' the map's origin "
                "if not given.",
                [0.0, 0.0, 0.8],
            ),
            "spacing": positive(
                f"Distance between neighbours, m; {SPACING:g} if not given. For a circle 'radius' "
                "may be given instead.",
                examples=[0.6],
            ),
            "radius": positive("Of the circle, m. Give this or 'spacing'.", examples=[0.8]),
            "rows": _many("Rows of the grid; as many as its columns need if not given."),
            "columns": _many("Columns of the grid; as square as it goes if not given."),
            "points": {
                "type": "array",
                "minItems": 1,
                "maxItems": MOST,
                "items": point("Place, [x, y, z] from the centre, m.", [0.5, 0.0, 0.0]),
                "description": "Places, from the centre, m, needed for 'points'; of more than "
                "there are agents some stay empty.",
                "examples": [[[0.0, 0.0, 0.8], [0.6, 0.0, 1.0]]],
            },
            "yaw_deg": {
                "type": "number",
                "description": "By how much to turn the formation, and the heading of its agents, "
                "degrees anticlockwise from the map's x axis; if not given it is not turned, and "
                "each agent keeps its own heading.",
                "examples": [90],
            },
            "speed": positive(
                "Greatest speed on the way to the places, m/s; limits.speed at most and if not "
                "given.",
                examples=[0.3],
            ),
            "within": positive("How near to its place each agent must come, m.", default=0.1),
            "for": {
                "type": "number",
                "minimum": 0,
                "description": "How long to stay once it is formed, s.",
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
                    "to": point(
                        "Where its centre moves to, [x, y, z] in the map, m.", [1.0, 0.0, 0.8]
                    ),
                    "speed": positive("Of the centre, m/s; limits.speed at most.", default=PACE),
                },
            },
        },
        "examples": [{"shape": "line", "centre": [0.0, 0.0, 0.8], "spacing": 0.6}],
    },
)
