"""The verb ``formation``: its options as JSON Schema, their checks, and the factory of its task."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final

from star_core import Problem, TaskSpec
from star_core.toolkit import StepGoal
from star_verbs.formation.shapes import Shape, grid_size, move_faults, shape
from star_verbs.positions import (
    TRAVEL_SPEED,
    bounded,
    changed,
    duration,
    number_label,
    point,
    speed_problems,
)

if TYPE_CHECKING:
    from star_core import Scene, Task

MAX_POINTS: Final = 100  # and rows, and columns
ROUNDING: Final = 1e-9  # m: permitted shortfall of a distance; positions are sums of floats
SHAPES_WITH: Final = {
    "spacing": ("line", "grid", "circle"),
    "radius": ("circle",),
    "rows": ("grid",),
    "columns": ("grid",),
    "points": ("points",),
}  # shapes that support an option


def _count(description: str) -> Mapping[str, Any]:
    limits = {"minimum": 1, "maximum": MAX_POINTS}
    return {"type": "integer", **limits, "description": description, "examples": [2]}


OPTIONS: Final[Mapping[str, Any]] = {
    "type": "object",
    "required": ["shape"],
    "properties": {
        "shape": {
            "enum": ["line", "grid", "circle", "points"],
            "description": "Shape to form; agents are assigned to its positions so that the "
            "total distance flown is minimal, and exchange them if they get stuck. A line lies "
            "along x, a grid has its columns along x, and a circle begins at its greatest x, "
            "before they are rotated.",
        },
        "centre": point(
            "Center of the formation, [x, y, z] in the map, m. The default for 'points' is "
            "the map's origin.",
            [0.0, 0.0, 0.8],
        ),
        "spacing": bounded(
            "Distance between neighbours, m. For a circle 'radius' may be given instead.",
            default=0.6,
        ),
        "radius": bounded("Radius of the circle, m. Give this or 'spacing'.", examples=[0.8]),
        "rows": _count("Rows of the grid; by default as many as its columns need."),
        "columns": _count("Columns of the grid; by default as square as possible."),
        "points": {
            "type": "array",
            "minItems": 1,
            "maxItems": MAX_POINTS,
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
        "speed": TRAVEL_SPEED,
        "within": bounded("Distance to its position each agent must reach, m.", default=0.1),
        "for": duration("Time to hold the formation once it is formed, s."),
        "move": {
            "type": "object",
            "description": "Where to move the formation as one after that; nowhere if not given.",
            "examples": [{"to": [1.0, 0.0, 0.8]}],
            "required": ["to"],
            "additionalProperties": False,
            "properties": {
                "to": point("Goal of its center, [x, y, z] in the map, m.", [1.0, 0.0, 0.8]),
                "speed": bounded("Of the center, m/s; at most limits.speed.", default=0.3),
            },
        },
    },
    "examples": [{"shape": "line", "centre": [0.0, 0.0, 0.8], "spacing": 0.6}],
}


def make(
    scene: Scene,
    rows: tuple[int, ...],
    /,  # `rows` is an option of the grid too
    **options: Any,
) -> Task:
    """Return the task."""
    from star_verbs.formation.formation import Formation

    return Formation(scene, rows, options)


def check(scene: Scene, rows: tuple[int, ...], /, **options: Any) -> Iterator[Problem]:
    """Yield the problems of a formation of the agents in `rows`."""
    yield from speed_problems(scene, options)
    move = changed(options.get("move", {}), OPTIONS["properties"]["move"])
    yield from speed_problems(scene, move, "move")
    if conflicts := [*_conflicts(changed(options, OPTIONS))] or [
        *_count_problems(len(rows), options)
    ]:
        yield from conflicts
        return
    figure = shape(len(rows), options)
    yield from _distance_problems(scene, figure, options)
    faults = [scene.position_fault(position) for position in figure.position]
    for i, fault in enumerate(faults):
        if fault is not None:
            label = "" if options["shape"] == "points" else number_label(i, len(faults))
            message = f"{label}: {fault}".removeprefix(": ")
            yield Problem(_path(i, options), message, "unreachable-goal")
    if not any(faults):
        for fault in move_faults(scene, figure):
            yield Problem(("move", "to"), fault, "unreachable-goal")


def goals(_scene: Scene, rows: tuple[int, ...], /, **options: Any) -> Iterator[StepGoal]:
    """Yield the positions of a formation, and those they pass as it moves."""
    figure = shape(len(rows), options)
    count = len(figure.position)
    for i, position in enumerate(figure.position):
        yield StepGoal(_path(i, options), position, number_label(i, count))
        label = f"position {i + 1} of {count} moves there"
        yield from (StepGoal(("move", "to"), passed, label) for passed in figure.passed(position))


SPEC: Final = TaskSpec(
    name="formation",
    before="air",
    after="air",
    summary="Form a line, a grid, a circle or points, hold it, and move it as a whole.",
    make=make,
    check=check,
    goals=goals,
    options=OPTIONS,
)


def _path(index: int, options: Mapping[str, Any]) -> tuple[str | int, ...]:
    """Return the option that a position follows from."""
    return ("points", index) if options["shape"] == "points" else ("centre",)


def _conflicts(options: Mapping[str, Any]) -> Iterator[Problem]:
    """Check options that exclude each other or the shape, and those it needs."""
    name = options["shape"]
    for key, shapes in SHAPES_WITH.items():
        if key in options and name not in shapes:
            listed = " or ".join(repr(shape) for shape in shapes)
            message = f"{key!r} goes with shape {listed}, not with {name!r}"
            yield Problem((key,), message, "option-conflict")
    if name == "circle" and "radius" in options and "spacing" in options:
        message = "'spacing' does not go with 'radius', expected one of them"
        yield Problem(("spacing",), message, "option-conflict")
    needed = "points" if name == "points" else "centre"
    if needed not in options:
        yield Problem((), f"shape {name!r} needs {needed!r}", "missing-option")


def _count_problems(agents: int, options: Mapping[str, Any]) -> Iterator[Problem]:
    """Check that there are enough positions for the agents."""
    if options["shape"] == "points" and len(options["points"]) < agents:
        count = len(options["points"])
        message = f"there are {count} points, expected one for each of {agents}"
        yield Problem(("points",), message, "out-of-range")
    if options["shape"] == "grid":
        rows, columns = grid_size(agents, options)
        if rows * columns < agents:
            message = (
                f"{rows} x {columns} positions are {rows * columns}, expected {agents}: "
                "one for each agent"
            )
            yield Problem(("rows",), message, "out-of-range")


def _distance_problems(
    scene: Scene, figure: Shape, options: Mapping[str, Any]
) -> Iterator[Problem]:
    """Check that positions are not closer to each other than the core permits."""
    limits = scene.limits
    least = f"expected at least limits.separation, {limits.separation:g} m"
    if options["shape"] != "points":
        if figure.min_distance < limits.separation - ROUNDING:
            key = "radius" if "radius" in options else "spacing"
            message = f"positions are {figure.min_distance:.2f} m from each other, {least}"
            yield Problem((key,), message, "too-close")
        return
    flat = limits.separation / limits.vertical_separation
    for (i, first), (j, second) in combinations(enumerate(figure.position), 2):
        aside, height = math.dist(first[:2], second[:2]), first[2] - second[2]
        if math.hypot(aside, flat * height) < limits.separation - ROUNDING:
            above = f"; limits.vertical_separation, {limits.vertical_separation:g} m, in height"
            distance = math.hypot(aside, height)
            message = f"positions are {distance:.2f} m from point {i + 1}, {least}"
            yield Problem(("points", j), message + above * (height != 0), "too-close")
