"""The point that each agent steers to, so that it rounds corners without cutting them."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Rows, compiled, subroutine
from star_visibility.line_of_sight import covered, sees
from star_visibility.regions import Regions

MAX_TRIES = 5  # lookahead points tried, each nearer to the next corner than the one before
ASTRAY = 0.1  # m farther from the exit point than before: the agent was pushed away
ENTERED = 0.05  # m from the beginning of the last segment: the agent is on that segment


@compiled
def steer(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    planned: Regions,
    kept: Regions,
    shunned: Regions,
    solid: Regions,
    here: Array,
    rows: Rows,
    start: Array,
    path: Array,
    count: Rows,
    leg: Rows,
    look_ahead: float,
) -> tuple[Array, Mask]:
    """Return each agent's lookahead point, and whether it lost sight of its path; advance its leg.

    It is the point of the path `look_ahead` ahead along the path, or nearer if that point
    is not visible: so the line to it is free, and its direction changes evenly as the agent comes
    to a corner. An agent inside the avoided region flies to the first point of a path that begins
    there, which leads out. It has lost its path if it has none, is past that point, or is pushed
    away from it. An agent that only enters the edge of the kept region may continue, also without
    sight of the first point of a path that begins there. An agent past a corner may thus use the
    distance by which paths exceed the kept region. A goal within the kept region is reached by the
    last segment of its path, which only obstacles block.

    Args:
        planned: Region that paths stay out of: agents that see past a corner without it skip it.
        kept: Region that lines must not cross.
        shunned: The same for lines that begin inside the first: most of it.
        solid: Obstacles.
        here: (N, 3) positions of the agents, m.
        rows: Rows to process.
        start: (N, 3) positions from which their paths were planned, m.
        path: (N, M, 3) remaining points when the path was planned, m.
        count: (N,) their numbers.
        leg: (N,) index of the point that each agent flies to; updated.
        look_ahead: Distance of that point along the path, m.

    Returns:
        (N, 3) points, m, 0 in other rows; and (N,) True where the next point of the path is hidden.
    """
    target = np.zeros(here.shape)
    lost = np.zeros(len(here), np.bool_)
    for i in rows:
        at, last, region = here[i], count[i] - 1, kept
        goal = path[i, last]
        if covered(kept, goal[0], goal[1], goal[2]) and _enters(
            solid, start[i], path[i], leg[i], last, at
        ):
            leg[i] = last
            _put(target, i, goal)
            continue
        grazes = covered(kept, at[0], at[1], at[2])
        if grazes:
            region = shunned
        if grazes and covered(shunned, at[0], at[1], at[2]):
            _put(target, i, path[i, leg[i]])
            lost[i] = leg[i] > 0 or not _leads_out(region, start[i], path[i, 0], at)
            continue
        while leg[i] < last and (
            sees(planned, at, path[i, leg[i] + 1]) or _is_past(region, at, path[i], leg[i])
        ):
            leg[i] += 1
        corner = path[i, leg[i]]
        if not sees(region, at, corner):
            _put(target, i, corner)
            lost[i] = leg[i] > 0 or not grazes or not _leads_out(kept, start[i], corner, at)
            continue
        _put(target, i, corner)
        room = look_ahead - _apart(at, corner)
        if room <= 0.0 or leg[i] == last:
            continue
        for k in range(MAX_TRIES):
            point = _along(path[i], leg[i], last, room * (MAX_TRIES - k) / MAX_TRIES)
            if sees(region, at, point):
                _put(target, i, point)
                break
    return target, lost


@subroutine
def _put(table: Array, row: int, point: Array) -> None:
    """Write a point into a table, element by element, which compiles seconds faster."""
    for k in range(3):
        table[row, k] = point[k]


@subroutine
def _leads_out(region: Regions, start: Array, out: Array, at: Array) -> bool:
    """Whether a path's first point is the exit from the region, and still is from `at`."""
    begins_within = covered(region, start[0], start[1], start[2])
    return begins_within and _apart(at, out) <= _apart(start, out) + ASTRAY


@subroutine
def _enters(region: Regions, start: Array, path: Array, leg: int, last: int, at: Array) -> bool:
    """Whether an agent is on the last segment of its path, or at its beginning."""
    if leg < last - 1:
        return False
    goal = path[last]
    stretch = _apart(path[last - 1] if last > 0 else start, goal)
    most = stretch + (ASTRAY if leg == last else ENTERED)
    return _apart(at, goal) <= most and sees(region, at, goal)


@subroutine
def _is_past(region: Regions, at: Array, path: Array, leg: int) -> bool:
    """Whether an agent has rounded a corner, close to it or as far off as others pushed it."""
    corner, following = path[leg], path[leg + 1]
    past = 0.0
    for k in range(3):
        past += (at[k] - corner[k]) * (following[k] - corner[k])
    if past < -1e-9:  # noqa: PLR2004 -- m²: it is at the corner
        return False
    return sees(region, at, following)


@subroutine
def _along(path: Array, leg: int, last: int, distance: float) -> Array:
    """Return the point of a path at a distance beyond one of its corners."""
    while leg < last:
        stretch = _apart(path[leg], path[leg + 1])
        if stretch >= distance:
            point = np.empty(3)
            for k in range(3):
                point[k] = path[leg, k] + (path[leg + 1, k] - path[leg, k]) * distance / stretch
            return point
        distance -= stretch
        leg += 1
    end: Array = path[last].copy()
    return end


@subroutine
def _apart(a: Array, b: Array) -> float:
    """Return the distance between two points, m."""
    return math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
