"""The heights of a path that flies over or under something: slopes in place of straight climbs."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, compiled
from star_visibility.sight import band_of, meeting
from star_visibility.walls import Walls


def sloped(walls: Walls, band: int, flat: Array, climb: tuple[float, float, float, float]) -> Array:
    """Return the points of a path that flies along a line in one band of heights: (K, 3) m.

    Its height changes evenly if that leads through nothing. Else it comes to the band's height
    where the line first meets what stands in the bands in between, and leaves it where the line
    last does: before and after nothing of those bands is in the way. If that is no slope, the path
    goes straight up and down.

    Args:
        walls: What the line keeps out of.
        band: The band it is in.
        flat: (M, 2) the line, m.
        climb: Heights at which the path begins, comes into the band, leaves it, and ends, m.
    """
    begin, first, last, end = climb
    passed = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(flat, axis=0).T))])
    length = float(passed[-1])
    there, back = 0.0, length
    if begin != first:
        there = met(walls, band_of(walls, begin), band, flat)
    if end != last:
        back = length - met(walls, band_of(walls, end), band, flat[::-1].copy())
    if _even(climb, there, back, length):
        knots = [(0.0, begin), (length, end)]
    elif there < back:
        knots = [(0.0, begin), (there, first), (back, last), (length, end)]
    else:
        knots = [(0.0, begin), (0.0, first), (length, last), (length, end)]
    where, height = np.array(knots).T
    between = passed[1:-1]
    at = np.concatenate([where, between])
    z = np.concatenate([height, np.interp(between, where, height)])
    order = np.argsort(at, kind="stable")
    x, y = (np.interp(at, passed, column) for column in flat.T)
    return np.column_stack([x, y, z])[order]


def _even(
    climb: tuple[float, float, float, float], there: float, back: float, length: float
) -> bool:
    """Whether a path whose height changes evenly is in the band from `there` to `back`, m."""
    begin, first, last, end = climb
    if begin == end:
        return first == begin
    into, out = (first - begin) / (end - begin), (last - begin) / (end - begin)
    return 0.0 <= into <= out <= 1.0 and into * length <= there and back <= out * length


@compiled
def met(walls: Walls, one: int, band: int, flat: Array) -> float:
    """Return how far along a line it first meets what stands in `one` band up to another, m.

    Args:
        walls: What stands there.
        one: A band, which counts.
        band: Another one, which does not.
        flat: (M, 2) the line, m.

    Returns:
        The distance, m; the length of the line if it meets nothing.
    """
    passed = 0.0
    for leg in range(len(flat) - 1):
        a, b = flat[leg], flat[leg + 1]
        nearest = np.inf
        for between in range(min(one, band), max(one, band) + 1):
            if between != band:
                at = meeting(walls, between, a[0], a[1], b[0], b[1], False)  # noqa: FBT003
                nearest = min(nearest, at)
        if nearest < np.inf:
            return passed + nearest
        passed += math.hypot(b[0] - a[0], b[1] - a[1])
    return passed
