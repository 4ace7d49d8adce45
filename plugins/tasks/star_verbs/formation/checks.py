"""Checks of a formation that a schema cannot express. Does not import numpy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final

from star_core import Problem, StepGoal
from star_verbs.formation.shapes import Point, Shape, shape, size_of_grid
from star_verbs.places import fault, too_fast

if TYPE_CHECKING:
    from star_core import Scene

STEP: Final = 0.05
"""Step in which the path of a position is checked, m: less than half a Crazyflie's span."""

SAME: Final = 1e-9
"""Permitted shortfall of a distance, m: positions are sums of floats."""

SHAPES_WITH: Final = {
    "spacing": ("line", "grid", "circle"),
    "radius": ("circle",),
    "rows": ("grid",),
    "columns": ("grid",),
    "points": ("points",),
}
"""Shapes that support an option."""


def check(scene: Scene, rows: tuple[int, ...], /, **options: Any) -> Iterator[Problem]:
    """Yield the problems of a formation of the agents in `rows`."""
    yield from too_fast(scene, options)
    yield from too_fast(scene, options.get("move", {}), "move")
    wrong = [*_company(options)] or [*_number(len(rows), options)]
    if wrong:
        yield from wrong
        return
    figure = shape(len(rows), options)
    yield from _apart(scene, figure, options)
    faults = [fault(scene, place) for place in figure.place]
    for i, message in enumerate(faults):
        if message is not None:
            several = len(faults) > 1 and options["shape"] != "points"
            path = ("points", i) if options["shape"] == "points" else ("centre",)
            yield Problem(
                path, f"place {i + 1} of {len(faults)}: {message}" if several else message
            )
    if not any(faults):
        yield from (Problem(("move", "to"), message) for message in way_faults(scene, figure))


def goals(_scene: Scene, rows: tuple[int, ...], /, **options: Any) -> Iterator[StepGoal]:
    """Yield the positions of a formation, and those they pass as it moves."""
    figure = shape(len(rows), options)
    of = len(figure.place)
    for i, place in enumerate(figure.place):
        path = ("points", i) if options["shape"] == "points" else ("centre",)
        label = f"place {i + 1} of {of}" if of > 1 else ""
        yield StepGoal(path, place, label)
        moving = f"place {i + 1} of {of} moves there"
        for point in _way(figure, place):
            yield StepGoal(("move", "to"), point, moving)


def faults(scene: Scene, figure: Shape) -> Iterator[str]:
    """Report positions that are not flyable, initially or on the way, and why."""
    of = len(figure.place)
    for number, place in enumerate(figure.place, start=1):
        if message := fault(scene, place):
            yield f"place {number} of {of}: {message}"
    yield from way_faults(scene, figure)


def way_faults(scene: Scene, figure: Shape) -> Iterator[str]:
    """Report positions that pass a point that is not flyable, where, and why."""
    for number, place in enumerate(figure.place, start=1):
        for on_the_way in _way(figure, place):
            if message := fault(scene, on_the_way):
                yield f"place {number} of {len(figure.place)} moves there: {message}"
                break


def _way(figure: Shape, place: Point) -> Iterator[Point]:
    """Yield the points that a position passes as the formation moves, at most `STEP` apart."""
    pieces = math.ceil(figure.way / STEP)
    for i in range(1, pieces + 1):
        x, y, z = (a + b * i / pieces for a, b in zip(place, figure.move, strict=True))
        yield x, y, z


def _company(options: dict[str, Any]) -> Iterator[Problem]:
    """Check options that exclude each other or the shape, and those it needs."""
    name = options["shape"]
    for key, shapes in SHAPES_WITH.items():
        if key in options and name not in shapes:
            listed = " or ".join(repr(one) for one in shapes)
            yield Problem((key,), f"{key!r} goes with shape {listed}, not with {name!r}")
    if name == "circle" and "radius" in options and "spacing" in options:
        yield Problem(("spacing",), "'spacing' does not go with 'radius', expected one of them")
    needed = "points" if name == "points" else "centre"
    if needed not in options:
        yield Problem((), f"shape {name!r} needs {needed!r}")


def _number(agents: int, options: dict[str, Any]) -> Iterator[Problem]:
    """Check that there are enough positions for the agents."""
    if options["shape"] == "points" and len(options["points"]) < agents:
        there = len(options["points"])
        yield Problem(("points",), f"there are {there} points, expected one for each of {agents}")
    if options["shape"] == "grid":
        rows, columns = size_of_grid(agents, options)
        if rows * columns < agents:
            yield Problem(
                ("rows",),
                f"{rows} x {columns} places are {rows * columns}, expected {agents}: "
                "one for each agent",
            )


def _apart(scene: Scene, figure: Shape, options: dict[str, Any]) -> Iterator[Problem]:
    """Check that positions are not nearer to each other than the core permits."""
    least = scene.limits.separation - SAME
    if options["shape"] == "points":
        for (i, one), (j, other) in combinations(enumerate(figure.place), 2):
            if math.dist(one, other) < least:
                yield Problem(("points", j), _near(math.dist(one, other), f"point {i + 1}", scene))
        return
    if figure.apart < least:
        key = next((key for key in ("spacing", "radius") if key in options), "shape")
        yield Problem((key,), _near(figure.apart, "each other", scene))


def _near(distance: float, whom: str, scene: Scene) -> str:
    return (
        f"places are {distance:.2f} m from {whom}, expected at least limits.separation, "
        f"{scene.limits.separation:g} m"
    )
