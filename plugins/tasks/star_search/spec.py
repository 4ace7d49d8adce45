"""The verb ``search``: its options as JSON Schema, their checks, and the factory of its task."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from star_core import ContractError, PluginError, Problem, TaskSpec
from star_core.toolkit import PluginGuard, number, positive, suggestion
from star_search.area import Area, area_corners, area_problems, swaths
from star_search.pattern import Pattern

if TYPE_CHECKING:
    from star_core import Registry, Scene, Task

PATTERN: Final = "search_pattern"
"""The kind of plugins that distribute scouts over the area."""

DEFAULT_SPEED: Final = 0.3  # m/s
VISITS: Final = ("land", "hover", "mark")  # values of on_found that take a finder's time
STAYS: Final = ("land", "hover")  # values of on_found with which a finder no longer searches

CORNER: Final = {
    "type": "array",
    "items": {"type": "number"},
    "minItems": 2,
    "maxItems": 2,
    "description": "x and y in the map, m.",
}


def make(
    registry: Registry,
    scene: Scene,
    rows: tuple[int, ...],
    *,
    pattern: str,
    on_found: str,
    mark_duration: float,
    targets: int | Sequence[str] | None = None,
    coverage: float,
    **options: Any,
) -> Task:
    """Return the task; other options are those of `SearchSpace`.

    Raises:
        PluginError: No agent has a camera, or the pattern cannot be made.
    """
    from star_search.search import Search
    from star_search.search_space import SearchSpace
    from star_search.target_visits import TargetVisits

    scouts = tuple(row for row in rows if scene.agents[row].camera is not None)
    if not scouts:
        message = f"no agent with a camera remains to search: {scene.named(rows)}"
        raise PluginError(message, code="missing-camera")
    space = SearchSpace(scene, scouts, **options)
    visits = TargetVisits(space, on_found=on_found, mark_duration=mark_duration)
    number = len(visits.names) if targets is None else targets
    entry = registry.find(PATTERN, pattern)
    with PluginGuard(f"search pattern {pattern!r} ({entry.source})"):
        made = entry.offer.make(space)
        if not isinstance(made, Pattern):
            expected = "expected begin(estimate, rows) and waypoints(estimate, rows)"
            raise ContractError(f"made {type(made).__name__}, {expected}")
    return Search(space, made, visits, targets=number, coverage=coverage)


def spec(registry: Registry) -> TaskSpec:
    """Return the verb, with all installed patterns in its schema."""
    patterns = registry.offers()[PATTERN]
    return TaskSpec(
        name="search",
        before="air",
        summary="Cover an area until targets are found.",
        make=partial(make, registry),
        check=partial(check, registry),
        options={
            "type": "object",
            "properties": {
                **OPTIONS,
                "pattern": {
                    "enum": list(patterns),
                    "description": "; ".join(
                        f"{name}: {offer.summary}" for name, offer in patterns.items()
                    ),
                    "default": "sweep",
                },
            },
            "if": {"properties": {"on_found": {"enum": list(VISITS)}}, "required": ["on_found"]},
            "then": {
                "properties": {
                    "until": {
                        "title": "Until",
                        "description": "A condition other than 'found'; none if not given.",
                        "examples": [{"elapsed": 60}],
                        "not": {"required": ["found"]},
                        "errorMessage": "'found' would end the search before the finder does what "
                        "'on_found' defines; give the number of finds in `targets:` instead",
                    }
                }
            },
            "examples": [{"pattern": "sweep", "height": 0.8, "timeout": 120}],
        },
    )


OPTIONS: Final[Mapping[str, Mapping[str, Any]]] = {
    "area": {
        "type": ["array", "object"],
        "items": {
            **CORNER,
            "errorMessage": "expected {low: [x, y], high: [x, y]}, or the corners [x, y] of a "
            "polygon in order, m",
        },
        "minItems": 3,
        "properties": {"low": CORNER, "high": CORNER},
        "required": ["low", "high"],
        "additionalProperties": False,
        "description": "Area to search: the corners [x, y] of a polygon in order, or "
        "{low: [x, y], high: [x, y]}, map frame, m; all inside the fence if not given.",
        "examples": [{"low": [-1.5, -1.5], "high": [1.5, 1.5]}],
    },
    "height": positive("Height to search from, z in the map, m.", default=0.8),
    "speed": positive("Speed limit, m/s; at most limits.speed.", default=DEFAULT_SPEED),
    "lane_spacing": positive(
        "Distance between lanes, m; from the camera's view of the floor if not given.",
        examples=[1.0],
    ),
    "clearance": number(
        "Distance of goals from obstacles and the fence, m; more than the planner's own.",
        minimum=0,
        default=0.3,
    ),
    "on_found": {
        "enum": ["continue", "land", "hover", "mark"],
        "description": "Action of an agent that finds a target: continue to search; land at it; "
        "hover over it until the end; or mark it, by hovering for mark_duration, then continue.",
        "default": "continue",
    },
    "mark_duration": number(
        "Time that a finder hovers over its target with on_found: mark, s.", minimum=0, default=3.0
    ),
    "targets": {
        "type": ["integer", "array"],
        "minimum": 0,
        "items": {"type": "string"},
        "minItems": 1,
        "uniqueItems": True,
        "description": "Number or names of the targets that end the search once they are found and "
        "their finders have done 'on_found'; all of the world's if not given. The search ends in "
        "any case when the area is covered; with 0, not before.",
        "examples": [3],
    },
    "coverage": positive(
        "Share of the visible floor of the area at which it is covered; the last "
        "hundredth, in patches of a few centimetres, may take as long as all the rest.",
        maximum=1,
        default=0.99,
    ),
}


def check(  # noqa: PLR0913 -- a mission's own options
    registry: Registry,
    scene: Scene,
    rows: tuple[int, ...],
    *,
    area: Area | None = None,
    height: float,
    speed: float,
    lane_spacing: float | None = None,
    clearance: float,
    on_found: str,
    targets: int | Sequence[str] | None = None,
    pattern: str,
    **_others: Any,
) -> Iterator[Problem]:
    """Yield every reason why a search cannot be flown."""
    try:
        registry.find(PATTERN, pattern)
    except PluginError as error:
        yield Problem(("pattern",), error.message, error.code)
    invalid_area = list(area_problems(scene, area))
    yield from invalid_area
    if fault := scene.height_fault(height):
        yield Problem(("height",), fault, "outside-geofence")
    limit = scene.limits.speed
    if speed != DEFAULT_SPEED and speed > limit:  # a default is lowered
        message = f"{speed:g} m/s is above limits.speed, {limit:g} m/s"
        yield Problem(("speed",), message, "out-of-range")
    fence = scene.world.fence
    width = min(fence.high[0] - fence.low[0], fence.high[1] - fence.low[1])
    if 2 * clearance >= width:
        message = f"{clearance:g} m on both sides leave nothing of the fence's {width:g} m"
        yield Problem(("clearance",), message, "out-of-range")
    unknown = list(_target_problems(scene, targets))
    yield from unknown
    blind = [row for row in rows if scene.agents[row].camera is None]
    if blind:
        has = "has" if len(blind) == 1 else "have"
        message = (
            f"{scene.named(blind)} {has} no camera to search with; "
            "give agents `camera: aideck`, or name those that have one"
        )
        yield Problem((), message, "missing-camera")
        return
    widths = dict(swaths(scene, rows, height, min(speed, limit)))
    yield from _width_problems(scene, widths, height, min(speed, limit), lane_spacing)
    if on_found in STAYS and not invalid_area and not unknown:
        separate = _separate_targets(scene, area, targets, max(widths.values()))
        if separate > len(rows):
            message = (
                f"each finder stays at its target, so {scene.named(rows)} cannot find the "
                f"{separate} that are in the area; send more scouts, let them 'mark' or "
                "'continue', or ask for fewer 'targets'"
            )
            yield Problem(("on_found",), message, "too-few-agents")


def _width_problems(
    scene: Scene,
    widths: Mapping[int, float],
    height: float,
    speed: float,
    lane_spacing: float | None,
) -> Iterator[Problem]:
    """Check that the first agent with too narrow a view sees the strip between lanes."""
    for row, widest in widths.items():
        name = scene.agents[row].name
        if widest <= 0:
            message = (
                f"from {height:g} m at {speed:g} m/s, {name!r} resolves no tag on the floor "
                "for long enough; search lower or slower, or turn its camera down"
            )
            yield Problem(("height",), message, "out-of-range")
            return
        if lane_spacing is not None and lane_spacing > widest:
            message = (
                f"{lane_spacing:g} m is more than the {widest:.2f} m in which {name!r} resolves "
                f"tags on the floor from {height:g} m"
            )
            yield Problem(("lane_spacing",), message, "out-of-range")
            return


def _separate_targets(
    scene: Scene, area: Area | None, targets: int | Sequence[str] | None, width: float
) -> int:
    """Return the number of sought targets in the area that are more than `width` m apart.

    A finder of one sees others within a camera's view of the floor too.
    """
    import shapely

    outline = shapely.Polygon(area_corners(scene, area))
    positions: dict[str, tuple[float, float]] = {}
    for tag in scene.world.targets:
        x, y, _ = tag.position
        relevant = targets is None or isinstance(targets, int) or tag.of in targets
        apart = all(math.dist(other, (x, y)) > width for other in positions.values())
        if relevant and tag.of not in positions and apart and shapely.contains_xy(outline, x, y):
            positions[tag.of] = (x, y)
    return min(len(positions), targets) if isinstance(targets, int) else len(positions)


def _target_problems(scene: Scene, targets: int | Sequence[str] | None) -> Iterator[Problem]:
    names = list(dict.fromkeys(tag.of for tag in scene.world.targets))
    if isinstance(targets, int):
        if targets > len(names):
            message = f"{targets!r} is more than the {len(names)} targets of the world"
            yield Problem(("targets",), message, "out-of-range")
        return
    for i, name in enumerate(targets or ()):
        if name not in names:
            message = f"no target named {name!r}{suggestion(name, names, 'there are')}"
            yield Problem(("targets", i), message, "unknown-target")
