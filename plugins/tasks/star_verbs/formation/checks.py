"""What is wrong with a formation that a schema cannot see. Nothing here imports numpy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final

from star_core import Problem
from star_verbs.formation.shapes import Shape, shape, size_of_grid
from star_verbs.places import fault, too_fast

if TYPE_CHECKING:
    from star_core import Scene

STEP: Final = 0.05
"""How finely the way of a place is looked at, m: less than half a Crazyflie's span."""

SAME: Final = 1e-9
"""By how much a distance may fall short of the least one, m: places are sums of floats."""

SHAPES_WITH: Final = {
    "spacing": ("line", "grid", "circle"),
    "radius": ("circle",),
    "rows": ("grid",),
    "columns": ("grid",),
    "points": ("points",),
}
"""Shapes that an option goes with."""


def check(scene: Scene, rows: tuple[int, ...], /, **options: Any) -> Iterator[Problem]:
    """Yield what is wrong with a formation of the agents in `rows`."""
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


def faults(scene: Scene, figure: Shape) -> Iterator[str]:
    """Say of each place that no agent can be at, at first or on the way, why not."""
    of = len(figure.place)
    for number, place in enumerate(figure.place, start=1):
        if message := fault(scene, place):
            yield f"place {number} of {of}: {message}"
    yield from way_faults(scene, figure)


def way_faults(scene: Scene, figure: Shape) -> Iterator[str]:
    """Say of each place that moves through where no agent can be where, and why not."""
    pieces = math.ceil(figure.way / STEP)
    for number, place in enumerate(figure.place, start=1):
        for i in range(1, pieces + 1):
            on_the_way = [a + b * i / pieces for a, b in zip(place, figure.move, strict=True)]
            if message := fault(scene, on_the_way):
                yield f"place {number} of {len(figure.place)} moves there: {message}"
                break


def _company(options: dict[str, Any]) -> Iterator[Problem]:
    """Options that do not go with the shape, or with each other, and those it needs."""
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
    """Fewer places than agents."""
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
    """Places nearer to each other than the core lets agents come."""
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
