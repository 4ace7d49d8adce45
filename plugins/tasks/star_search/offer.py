"""What the verb ``search`` takes, as JSON Schema, and how its task is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from star_core import PluginError, TaskSpec
from star_search.area import Area
from star_search.checks import DEFAULT_SPEED, check
from star_search.choice import names

if TYPE_CHECKING:
    from star_core import Scene, Task


VISITS: Final = ("land", "hover", "mark")
"""What `then` may say that takes a finder's time."""


def make(  # noqa: PLR0913 -- a mission's own options
    scene: Scene,
    rows: tuple[int, ...],
    *,
    area: Area | None = None,
    pattern: str,
    height: float,
    speed: float,
    swath: float | None = None,
    clearance: float,
    then: str,
    mark_for: float,
    targets: int | Sequence[str] | None = None,
    coverage: float,
) -> Task:
    from star_search.choice import made
    from star_search.field import Field
    from star_search.finds import Finds
    from star_search.search import Search

    able = tuple(row for row in rows if scene.agents[row].camera is not None)
    if not able:
        raise PluginError(f"nobody with a camera is left to search: {scene.named(rows)}")
    field = Field(
        scene, able, area=area, height=height, speed=speed, swath=swath, clearance=clearance
    )
    finds = Finds(field, then=then, mark_for=mark_for)
    enough = len(finds.names) if targets is None else targets
    return Search(field, made(pattern, field), finds, targets=enough, coverage=coverage)


def offer() -> TaskSpec:
    """Return the verb, with every pattern that is installed."""
    corner = {
        "type": "array",
        "items": {"type": "number"},
        "minItems": 2,
        "maxItems": 2,
        "description": "x and y in the map, m.",
    }
    properties: dict[str, Mapping[str, Any]] = {
        "area": {
            "type": ["array", "object"],
            "items": {
                **corner,
                "errorMessage": "expected {low: [x, y], high: [x, y]}, or the corners [x, y] of a "
                "polygon in order, m",
            },
            "minItems": 3,
            "properties": {"low": corner, "high": corner},
            "required": ["low", "high"],
            "additionalProperties": False,
            "description": "What to search: the corners [x, y] of a polygon in order, or "
            "{low: [x, y], high: [x, y]}, map frame, m; all inside the fence if not given.",
            "examples": [{"low": [-1.5, -1.5], "high": [1.5, 1.5]}],
        },
        "pattern": {
            "enum": list(names()),
            "description": "sweep: lanes side by side, then what they missed; frontier: always to "
            "where most that was not seen can be seen soonest.",
            "default": "sweep",
        },
        "height": _positive("Height to search from, z in the map, m.", default=0.8),
        "speed": _positive("Greatest speed, m/s; limits.speed at most.", default=DEFAULT_SPEED),
        "swath": _positive(
            "Distance between lanes, m; from the camera's view of the floor if not given.",
            examples=[1.0],
        ),
        "clearance": {
            "type": "number",
            "minimum": 0,
            "description": "Distance of goals from obstacles and the fence, m; more than the "
            "planner's own.",
            "default": 0.3,
        },
        "then": {
            "enum": ["continue", "land", "hover", "mark"],
            "description": "What the finder of a target does: search on; land at it; stay over it "
            "to the end; or mark it, which is to stay over it for a while, and then search on.",
            "default": "continue",
        },
        "mark_for": {
            "type": "number",
            "minimum": 0,
            "description": "How long a finder stays over its target with then: mark, s.",
            "default": 3.0,
        },
        "targets": {
            "type": ["integer", "array"],
            "minimum": 0,
            "items": {"type": "string"},
            "minItems": 1,
            "uniqueItems": True,
            "description": "How many targets, or which by name, end the search once they are "
            "found and their finders have done what 'then' says; all of the world's if not given. "
            "It ends in any case when the area is covered; with 0, not before.",
            "examples": [3],
        },
        "coverage": {
            "type": "number",
            "exclusiveMinimum": 0,
            "maximum": 1,
            "description": "Share of what can be seen of the area at which it is covered; the last "
            "hundredth, in patches of a few centimetres, may take as long as all the rest.",
            "default": 0.99,
        },
    }
    return TaskSpec(
        name="search",
        before="air",
        summary="Cover an area until targets are found.",
        make=make,
        check=check,
        options={
            "type": "object",
            "properties": properties,
            "if": {"properties": {"then": {"enum": list(VISITS)}}, "required": ["then"]},
            "then": {
                "properties": {
                    "until": {
                        "title": "Until",
                        "description": "A condition other than 'found'; none if not given.",
                        "examples": [{"elapsed": 60}],
                        "not": {"required": ["found"]},
                        "errorMessage": "'found' would end the search before the finder does what "
                        "'then' says; say `targets:` for how many are enough, in place of it",
                    }
                }
            },
            "examples": [{"pattern": "sweep", "height": 0.8, "timeout": 120}],
        },
    )


def _positive(description: str, **more: Any) -> Mapping[str, Any]:
    return {"type": "number", "exclusiveMinimum": 0, "description": description, **more}
