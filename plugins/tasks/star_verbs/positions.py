"""Options that several verbs share, and the positions of several agents sent to one point."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from star_core import Problem
from star_core.toolkit import StepGoal, number, positive

if TYPE_CHECKING:
    from star_core import Scene


Point = tuple[float, float, float]

# Possible centers of a compact pattern on a hexagonal lattice of unit spacing: a point, the
# midpoint of two, and the center of three.
_CENTERS = ((0.0, 0.0), (0.5, 0.0), (0.5, math.sqrt(3) / 6))


def spread(n: int, centre: Sequence[float], spacing: float) -> list[Point]:
    """Return `n` positions around `centre`, all at its height, at least `spacing` apart.

    They are the `n` points of a hexagonal lattice nearest to its center, moved so that their mean
    is `centre`: one agent gets the center, two a line along x, three a triangle, seven a ring
    around one. Of the lattice's three possible centers the most compact is taken.

    Args:
        n: Number of agents.
        centre: x, y, z, m.
        spacing: Distance between neighbours, m.

    Example:
        >>> spread(2, (1, 0, 0.8), 0.5)
        [(0.75, 0.0, 0.8), (1.25, 0.0, 0.8)]
    """
    x, y, z = centre
    return [(x + spacing * u, y + spacing * v, float(z)) for u, v in _pattern(n)]


def offsets(n: int, spacing: float) -> list[Point]:
    """Return the offsets of the lines of `n` agents that fly side by side, m."""
    return spread(n, (0.0, 0.0, 0.0), spacing)


def shifted(point: Sequence[float], offset: Sequence[float]) -> Point:
    """Return a point shifted by an offset."""
    x, y, z = (a + b for a, b in zip(point, offset, strict=True))
    return x, y, z


def offset_label(offset: Point, agents: int) -> str:
    """Return the suffix of a message about a point that is shifted for one of several agents.

    >>> offset_label((0.3, 0.0, 0.0), 2)
    ', shifted by [0.3, 0, 0] for one of 2 agents'
    """
    x, y, z = offset
    if agents == 1 or not any(offset):
        return ""
    return f", shifted by [{x:g}, {y:g}, {z:g}] for one of {agents} agents"


def number_label(index: int, count: int) -> str:
    """Return which of several positions one is, for messages; empty if there is only one."""
    return f"position {index + 1} of {count}" if count > 1 else ""


def points_between(a: Sequence[float], b: Sequence[float], step: float) -> Iterator[Point]:
    """Yield points from `a` to `b`, both included, no more than `step` apart.

    >>> [x for x, _, _ in points_between((0, 0, 0), (1, 0, 0), 0.5)]
    [0.0, 0.5, 1.0]
    """
    pieces = max(1, math.ceil(math.dist(a, b) / step))
    for i in range(pieces + 1):
        x, y, z = (p + i / pieces * (q - p) for p, q in zip(a, b, strict=True))
        yield x, y, z


def extents(scene: Scene) -> Point:
    """Return the extent of the fence and the flight heights along x, y and z, m."""
    fence, (low, high) = scene.world.fence, scene.limits.height
    x, y, _ = (b - a for a, b in zip(fence.low, fence.high, strict=True))
    return x, y, min(fence.high[2], high) - max(fence.low[2], low)


def spread_goals(
    _scene: Scene, rows: tuple[int, ...], *, spacing: float, key: str, **options: Any
) -> Iterator[StepGoal]:
    """Yield the positions of agents sent around the point that the option `key` may give."""
    if key in options:
        for i, position in enumerate(spread(len(rows), options[key], spacing)):
            yield StepGoal((key,), position, number_label(i, len(rows)))


def spread_problems(
    scene: Scene, rows: tuple[int, ...], *, key: str, **options: Any
) -> Iterator[Problem]:
    """Check the positions of agents sent around the point that the option `key` may give."""
    if key not in options:
        return
    if too_close := list(spacing_problems(scene, len(rows), options)):
        yield from too_close
        return
    for goal in spread_goals(scene, rows, key=key, **options):
        if fault := scene.position_fault(goal.position):
            message = f"{goal.label}: {fault}".removeprefix(": ")
            yield Problem(goal.path, message, "unreachable-goal")


def spacing_problems(scene: Scene, agents: int, options: Mapping[str, Any]) -> Iterator[Problem]:
    """Check that the spacing is not less than the separation that the core enforces."""
    spacing, least = options["spacing"], scene.limits.separation
    if agents > 1 and spacing < least:
        message = f"a spacing of {spacing:g} m is less than limits.separation, {least:g} m"
        yield Problem(("spacing",), message, "too-close")


def speed_problems(scene: Scene, options: Mapping[str, Any], *path: str) -> Iterator[Problem]:
    """Check that a given ``speed``, at `path`, does not exceed the limit; a default is lowered."""
    limit = scene.limits.speed
    if options.get("speed", 0.0) > limit:
        message = f"{options['speed']:g} m/s is above limits.speed, {limit:g} m/s"
        yield Problem((*path, "speed"), message, "out-of-range")


@lru_cache(maxsize=32)  # many steps of a mission spread the same number of agents
def _pattern(n: int) -> list[tuple[float, float]]:
    """The most compact `n` points of a lattice of unit spacing, relative to their mean."""
    _, pattern = min(_compact(n, center) for center in _CENTERS)
    return pattern


def _compact(n: int, center: tuple[float, float]) -> tuple[float, list[tuple[float, float]]]:
    """The `n` lattice points nearest to `center` relative to their mean, and their mean square."""
    reach = math.isqrt(n) + 2  # rows and columns that contain more than n points around the center
    lattice = (
        (i + j / 2 - center[0], j * math.sqrt(3) / 2 - center[1])
        for i in range(-2 * reach, 2 * reach + 1)
        for j in range(-reach, reach + 1)
    )
    # Rounded, so that points at equal distances are ordered by their position and not by noise.
    nearest = sorted(lattice, key=lambda p: (round(math.hypot(*p), 6), round(p[1], 6), p[0]))[:n]
    x, y = (math.fsum(values) / n for values in zip(*nearest, strict=True))
    pattern = [(u - x, v - y) for u, v in nearest]
    return round(math.fsum(u * u + v * v for u, v in pattern), 6), pattern


MAX_VALUE: Final = 1000  # of an option, in its own unit: in meters, far more than a room


def point(description: str, example: Sequence[float]) -> Mapping[str, Any]:
    """Return the schema of a point or an offset, [x, y, z], m."""
    return {
        "type": "array",
        "items": {"type": "number", "minimum": -MAX_VALUE, "maximum": MAX_VALUE},
        "minItems": 3,
        "maxItems": 3,
        "description": description,
        "examples": [list(example)],
    }


def bounded(description: str, **rules: Any) -> Mapping[str, Any]:
    """Return the schema of a number greater than 0 and at most `MAX_VALUE`."""
    return positive(description, maximum=MAX_VALUE, **rules)


def duration(description: str) -> Mapping[str, Any]:
    """Return the schema of a duration, s, that is 0 by default."""
    return number(description, minimum=0, default=0.0, examples=[5])


SPACING: Final = bounded("Least distance between agents sent to one point, m.", default=0.6)
TRAVEL_SPEED: Final = bounded(
    "Speed limit on the way, m/s; at most limits.speed, and that if not given.", examples=[0.3]
)


def changed(options: Mapping[str, Any], schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that differ from their defaults."""
    rules = schema["properties"]
    return {key: value for key, value in options.items() if value != rules[key].get("default")}


def exactly_one(first: str, second: str, options: Mapping[str, Any]) -> Iterator[Problem]:
    """Check that exactly one of two options is given."""
    if first not in options and second not in options:
        yield Problem((), f"expected {first!r} or {second!r}", "missing-option")
    elif first in options and second in options:
        message = f"{second!r} does not go with {first!r}, expected one of them"
        yield Problem((second,), message, "option-conflict")
