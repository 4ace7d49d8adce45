"""The shortest way through a visibility graph, searched in portions."""

from __future__ import annotations

import math
from typing import NamedTuple

from star_core import Array, Mask, Rows, compiled
from star_visibility.openings import openings
from star_visibility.tangents import Corners, Graph, passes
from star_visibility.walls import Walls

MORE, FOUND, NONE, FULL = 0, 1, 2, 3
"""How far a search is: not through, through, through without a way, in need of a longer queue."""

SHORTER = 1e-12  # m; less than this is no gain
SAME = 1e-9  # m; heights that differ by less are the same


class Places(NamedTuple):
    """Points that paths turn or change their height at.

    At each point one or more heights are free; each is a state of its own. A search keeps to one.

    Attributes:
        place: (P, 2) the corners of a `Corners`, then other points, m.
        first: (P + 1,) first state of each point, and one past the last.
        open: (S, 2) least and greatest height that can be come to there without moving aside, m.
        come: (S, 2) least and greatest height to come there at, m: at those of its own block.
        of: (S,) the point.
    """

    place: Array
    first: Rows
    open: Array
    come: Array
    of: Rows


class Net(NamedTuple):
    """What stands in a world, and the stretches between its corners.

    Attributes:
        parts: Blocks, in place of bands.
        span: (G, 2) least and greatest height of each, m.
        corner: Their corners.
        graph: The tangents between those.
    """

    parts: Walls
    span: Array
    corner: Corners
    graph: Graph


class Goal(NamedTuple):
    """Where a search is to come to.

    Attributes:
        point: The row of it in `Places`.
        x: m.
        y: m.
        z: m.
        most: Ways that are not shorter than this are left out, m.
        steep: Whether a way climbs where it is, and no sooner; else it climbs evenly, as if it
            could. The one takes ways for too long, the other for too short.
    """

    point: int
    x: float
    y: float
    z: float
    most: float
    steep: bool


class Search(NamedTuple):
    """What is known in a search; written by it.

    Attributes:
        flat: (S,) shortest way to each state, in the plane, m; with its climbs if `Goal.steep`.
        climb: (S,) how much it goes up and down, m.
        z: (S,) height at which it comes there, m.
        total: (S,) least length by way of it, m.
        came: (S,) state it comes from; -1 for none.
        done: (S,) whether that is final.
        key: (Q,) queue: least lengths, a heap.
        who: (Q,) state to go on from.
        to: (Q,) point to go to; -1 for a state that was come to.
        by: (Q,) stretch of the graph that leads there; -1 for one that is not looked at yet.
        size: (2,) entries in the queue, and how many more one step may need.
    """

    flat: Array
    climb: Array
    z: Array
    total: Array
    came: Rows
    done: Mask
    key: Array
    who: Rows
    to: Rows
    by: Rows
    size: Rows


@compiled
def advance(
    net: Net, places: Places, search: Search, goal: Goal, left: int
) -> tuple[int, int, int]:
    """Search on, and return how far it is, the goal's state if it was found, and what is left.

    This is A* (Hart, Nilsson and Raphael, IEEE SSC 4(2), 1968). A way that is h long in the plane
    and climbs by v in all is at least hypot(h, v) long, and as long if its slope is even; so is
    what is left to the goal. A stretch is looked at when no shorter one is left to look at.

    Args:
        net: Blocks, corners and tangents.
        places: Corners and other points.
        search: What is known; written.
        goal: Where to.
        left: Work allowed: how many boxes around rings, and points, may be looked at.
    """
    while left > 0:
        if search.size[0] == 0:
            return NONE, -1, left
        if search.size[0] + search.size[1] > len(search.key):
            return FULL, -1, left
        key, i, to, by = _pop(search)
        left -= 1
        if to < 0:
            if search.done[i]:
                continue
            search.done[i] = True
            if places.of[i] == goal.point:
                return FOUND, i, left
            left -= _go_on(net, places, search, goal, i)
        elif not _beaten(places, search, to, key):
            if by < 0:
                left -= _look(net, places, search, goal, i, to)
            else:
                _come(places, search, goal, (i, to), net.graph.open[by])
    return MORE, -1, left


@compiled
def _go_on(net: Net, places: Places, search: Search, goal: Goal, i: int) -> int:
    """Queue what leads on from a state, and return how many points were looked at.

    From corner to corner lead the tangents of the graph; to and from any other point, whatever
    leaves a corner on one side.
    """
    corner, n, p = net.corner, len(net.corner.place), places.of[i]
    at = places.place[p]
    begin, count = 0, len(places.place)
    if p < n:
        begin = n
        for k in range(net.graph.first[p], net.graph.first[p + 1]):
            _offer(places, search, goal, i, net.graph.to[k], k)
            count += 1
    for q in range(begin, len(places.place)):
        if q < n:
            tangent = passes(at, places.place[q], corner.before[q], corner.after[q])
        else:
            tangent = p >= n or passes(places.place[q], at, corner.before[p], corner.after[p])
        if tangent and q != p:
            _offer(places, search, goal, i, q, -1)
    return count - begin


@compiled
def _look(net: Net, places: Places, search: Search, goal: Goal, i: int, to: int) -> int:
    """Look at the stretch from a state to a point; return how many boxes that took at most."""
    p, n = places.of[i], len(net.corner.place)
    touches = (
        net.corner.block[p] if p < n else -1,
        net.corner.block[to] if to < n else -1,
    )
    heights = (places.open[i, 0], places.open[i, 1])
    free = openings(net.parts, net.span, places.place[p], places.place[to], heights, touches)
    for k in range(len(free)):
        _come(places, search, goal, (i, to), free[k])
    return 2 * len(net.parts.box)


@compiled
def _offer(places: Places, search: Search, goal: Goal, i: int, to: int, by: int) -> None:
    """Put a stretch from a state to a point into the queue, if it may lead to a shorter way."""
    a, b = places.place[places.of[i]], places.place[to]
    flat = search.flat[i] + math.hypot(b[0] - a[0], b[1] - a[1])
    ahead = flat - search.flat[i] + math.hypot(goal.x - b[0], goal.y - b[1])
    if goal.steep:
        key = search.flat[i] + math.hypot(ahead, search.z[i] - goal.z)
    else:
        key = math.hypot(search.flat[i] + ahead, search.climb[i] + abs(search.z[i] - goal.z))
    if key < goal.most and not _beaten(places, search, to, key):
        _push(search, key, i, to, by)


@compiled
def _beaten(places: Places, search: Search, to: int, key: float) -> bool:
    """Whether no state of a point has a longer way than this, m."""
    for j in range(places.first[to], places.first[to + 1]):
        if not search.done[j] and search.total[j] > key + SHORTER:
            return False
    return True


@compiled
def _come(
    places: Places, search: Search, goal: Goal, ends: tuple[int, int], heights: Array
) -> None:
    """Take note of the stretch from a state to a point, which is free at some heights."""
    i, to = ends
    a, b = places.place[places.of[i]], places.place[to]
    away = math.hypot(b[0] - a[0], b[1] - a[1])
    flat = search.flat[i] + away
    rest = math.hypot(goal.x - b[0], goal.y - b[1])
    for j in range(places.first[to], places.first[to + 1]):
        least = max(heights[0], places.open[i, 0], places.come[j, 0])
        greatest = min(heights[1], places.open[i, 1], places.come[j, 1])
        if search.done[j] or least > greatest or not _ends(places, goal, j):
            continue
        z = min(max(search.z[i], least), greatest)
        climb = search.climb[i] + abs(z - search.z[i])
        if goal.steep:
            begin, climb = z, 0.0
            z += (goal.z - z) * away / max(away + rest, SAME)
            z = min(max(z, least), greatest)
            flat = search.flat[i] + abs(begin - search.z[i]) + math.hypot(away, z - begin)
            total = flat + math.hypot(rest, goal.z - z)
        else:
            total = math.hypot(flat + rest, climb + abs(goal.z - z))
        if total < min(search.total[j] - SHORTER, goal.most):
            search.flat[j], search.climb[j], search.z[j] = flat, climb, z
            search.total[j], search.came[j] = total, i
            _push(search, total, j, -1, -1)


@compiled
def _ends(places: Places, goal: Goal, j: int) -> bool:
    """Whether a state is not at the goal's point, or the one from which the goal is come to."""
    return places.of[j] != goal.point or bool(
        places.open[j, 0] - SAME <= goal.z <= places.open[j, 1] + SAME
    )


@compiled
def _push(search: Search, key: float, who: int, to: int, by: int) -> None:
    k = search.size[0]
    search.size[0] += 1
    while k > 0:
        above = (k - 1) // 2
        if search.key[above] <= key:
            break
        _move(search, above, k)
        k = above
    search.key[k], search.who[k], search.to[k], search.by[k] = key, who, to, by


@compiled
def _pop(search: Search) -> tuple[float, int, int, int]:
    """Take the entry with the least length out of the queue."""
    top = search.key[0], search.who[0], search.to[0], search.by[0]
    search.size[0] -= 1
    last, k = search.size[0], 0
    while True:
        below = 2 * k + 1
        if below + 1 < last and search.key[below + 1] < search.key[below]:
            below += 1
        if below >= last or search.key[last] <= search.key[below]:
            break
        _move(search, below, k)
        k = below
    _move(search, last, k)
    return top


@compiled
def _move(search: Search, one: int, other: int) -> None:
    search.key[other], search.who[other] = search.key[one], search.who[one]
    search.to[other], search.by[other] = search.to[one], search.by[one]
