"""The point that each agent steers to so that it rounds its path's corners and cuts none off."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Rows, compiled
from star_visibility.sight import covered, sees
from star_visibility.walls import Walls

TRIES = 5  # carrots looked at, each nearer to the next corner than the one before
ASTRAY = 0.1  # m farther from the way out than it was: it was pushed away


@compiled
def steer(  # noqa: PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    planned: Walls,
    kept: Walls,
    shunned: Walls,
    here: Array,
    rows: Rows,
    start: Array,
    path: Array,
    count: Rows,
    leg: Rows,
    look_ahead: float,
) -> tuple[Array, Mask]:
    """Return what each agent steers to, and whether it lost sight of its path; move its leg on.

    The carrot is the point of the path that lies `look_ahead` ahead, counted along the path, or
    nearer if that cannot be seen: so the line to it is free, and it turns evenly as the agent comes
    to a corner. An agent that is in what is to be shunned goes to the first point of a path that
    begins there: that leads out. It lost its path if it has none such, has gone further than that
    point, or is pushed away from it. One that only grazes what is to be kept free may go on, also
    out of sight to the first point of a path that begins there. Who is past a corner may so use up
    what paths were kept out of beyond that.

    Args:
        planned: What paths were kept out of: who sees beyond a corner without it leaves it out.
        kept: What lines must not go through.
        shunned: What they must not go through from within the first: the most of it.
        here: (N, 3) where the agents are, m.
        rows: Rows to look at.
        start: (N, 3) where their paths were planned from, m.
        path: (N, M, 3) points still to fly to when the path was planned, m.
        count: (N,) how many of them there are.
        leg: (N,) the one that each agent flies to; written.
        look_ahead: How far ahead the carrot is, m.

    Returns:
        (N, 3) points, m, those of other rows 0; and (N,) True where the next point is not seen.
    """
    target = np.zeros(here.shape)
    lost = np.zeros(len(here), np.bool_)
    for i in rows:
        at, last, walls = here[i], count[i] - 1, kept
        grazes = covered(kept, at[0], at[1], at[2])
        if grazes:
            walls = shunned
        if grazes and covered(shunned, at[0], at[1], at[2]):
            _put(target, i, path[i, leg[i]])
            lost[i] = leg[i] > 0 or not _leads_out(walls, start[i], path[i, 0], at)
            continue
        while leg[i] < last and (
            sees(planned, at, path[i, leg[i] + 1]) or _is_past(walls, at, path[i], leg[i])
        ):
            leg[i] += 1
        corner = path[i, leg[i]]
        if not sees(walls, at, corner):
            _put(target, i, corner)
            lost[i] = leg[i] > 0 or not grazes or not _leads_out(kept, start[i], corner, at)
            continue
        _put(target, i, corner)
        room = look_ahead - _apart(at, corner)
        if room <= 0.0 or leg[i] == last:
            continue
        for k in range(TRIES):
            carrot = _along(path[i], leg[i], last, room * (TRIES - k) / TRIES)
            if sees(walls, at, carrot):
                _put(target, i, carrot)
                break
    return target, lost


@compiled
def _put(table: Array, row: int, point: Array) -> None:
    """Write a point into a table; number by number, which takes seconds less to compile."""
    for k in range(3):
        table[row, k] = point[k]


@compiled
def _leads_out(walls: Walls, start: Array, out: Array, at: Array) -> bool:
    """Whether a path's first point is the way out of the walls, and still is so from `at`."""
    begins_within = covered(walls, start[0], start[1], start[2])
    return begins_within and _apart(at, out) <= _apart(start, out) + ASTRAY


@compiled
def _is_past(walls: Walls, at: Array, path: Array, leg: int) -> bool:
    """Whether an agent has come round a corner, near it or as far off as others pushed it."""
    corner, following = path[leg], path[leg + 1]
    past = 0.0
    for k in range(3):
        past += (at[k] - corner[k]) * (following[k] - corner[k])
    if past < -1e-9:  # noqa: PLR2004 -- m²: it is at the corner
        return False
    return sees(walls, at, following)


@compiled
def _along(path: Array, leg: int, last: int, distance: float) -> Array:
    """Return the point of a path that lies a distance beyond one of its corners."""
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


@compiled
def _apart(a: Array, b: Array) -> float:
    """Return the distance between two points, m."""
    return math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
