"""The named closed paths, as points. Does not import numpy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

Point = tuple[float, float, float]
PIECES = 360  # chords of a curve: those of a 4 m circle deviate from it by less than 0.1 mm


def box(size: float) -> list[tuple[float, float]]:
    """A square of side `size` about the origin, anticlockwise from its lower left corner."""
    half = size / 2
    return [(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)]


def circle(size: float) -> list[tuple[float, float]]:
    """A circle of diameter `size` about the origin, anticlockwise from its greatest x."""
    return [(size / 2 * math.cos(t), size / 2 * math.sin(t)) for t in _turn()]


def figure8(size: float) -> list[tuple[float, float]]:
    """A lemniscate of Gerono, `size` long in x and half as wide, from its crossing towards +x, +y.

    The curve is ``x = a sin t``, ``y = a sin t cos t`` with ``a = size / 2``.
    """
    half = size / 2
    return [(half * math.sin(t), half * math.sin(t) * math.cos(t)) for t in _turn()]


SHAPES: dict[str, Callable[[float], list[tuple[float, float]]]] = {
    "box": box,
    "circle": circle,
    "figure8": figure8,
}


def shape(
    name: str, size: float, centre: Sequence[float], width: float | None = None
) -> tuple[Point, ...]:
    """Return the points of one lap of a named path around `centre`; the last equals the first.

    Args:
        name: Key of `SHAPES`.
        size: Side, diameter or length, m.
        centre: x, y, z of its center, m; the path is level.
        width: Along y, m; the path's own if not given.

    Example:
        >>> shape("box", 2.0, (1, 1, 0.8), width=1.0)[:2]
        ((0.0, 0.5, 0.8), (2.0, 0.5, 0.8))
    """
    x, y, z = (float(value) for value in centre)
    corners = SHAPES[name](size)
    corners[-1] = corners[0]  # closed to the last bit
    own = size / 2 if name == "figure8" else size
    stretch = 1.0 if width is None else width / own
    return tuple((x + u, y + stretch * v, z) for u, v in corners)


def places(name: str, agents: int) -> int:
    """Number of equal parts into which a lap is divided for a number of agents.

    As many as there are agents; on the figure 8 an odd number, so that no two agents, half a lap
    apart, reach its crossing at the same time.

    >>> places("circle", 2), places("figure8", 2), places("figure8", 3)
    (2, 3, 3)
    """
    if name == "figure8" and agents > 1:
        return agents + 1 - agents % 2
    return agents


def _turn() -> list[float]:
    return [math.tau * i / PIECES for i in range(PIECES + 1)]
