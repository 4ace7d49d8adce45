"""Shortest paths through a visibility graph, searched in portions."""

from __future__ import annotations

import math
from typing import NamedTuple

from star_core import Array, Mask, Rows
from star_core.toolkit import compiled, subroutine
from star_visibility.openings import openings
from star_visibility.regions import Regions
from star_visibility.tangents import Corners, Graph, passes

MORE, FOUND, NONE, FULL = 0, 1, 2, 3
"""Status of a search: incomplete, path found, no path exists, queue too short."""

SHORTER = 1e-12  # m; a smaller improvement is ignored
SAME = 1e-9  # m; heights that differ by less are equal


class Nodes(NamedTuple):
    """Points at which paths turn or change their height.

    Each point has one or more ranges of free heights; each range is a separate state.

    Attributes:
        position: (P, 2) the corners of a `Corners`, then other points, m.
        first: (P + 1,) first state of each point, and one past the last.
        open: (S, 2) least and greatest height reachable there without horizontal motion, m.
        come: (S, 2) least and greatest height at which to arrive, m: those of the point's block.
        of: (S,) the point.
    """

    position: Array
    first: Rows
    open: Array
    come: Array
    of: Rows


class Net(NamedTuple):
    """The blocks of a world, and the segments between their corners.

    Attributes:
        parts: Blocks, used as bands.
        span: (G, 2) least and greatest height of each, m.
        corner: Their corners.
        graph: The tangents between those.
    """

    parts: Regions
    span: Array
    corner: Corners
    graph: Graph


class Goal(NamedTuple):
    """The goal of a search.

    Attributes:
        point: Its row in `Nodes`.
        x: m.
        y: m.
        z: m.
        most: Paths that are not shorter than this are ignored, m.
        steep: Whether a path climbs only where it is; otherwise it climbs evenly, as if it could.
            The first overestimates lengths, the second underestimates them.
    """

    point: int
    x: float
    y: float
    z: float
    most: float
    steep: bool


class Search(NamedTuple):
    """State of a search; updated by it.

    Attributes:
        flat: (S,) shortest path to each state, in the plane, m; with its climbs if `Goal.steep`.
        climb: (S,) total of its climbs and descents, m.
        z: (S,) height at which it arrives there, m.
        total: (S,) lower bound of the length via it, m.
        came: (S,) previous state; -1 for none.
        done: (S,) whether that is final.
        key: (Q,) queue: lower bounds of lengths, a heap.
        origin: (Q,) state to continue from.
        to: (Q,) point to continue to; -1 for a state that was reached.
        by: (Q,) segment of the graph that leads there; -1 for one that is not examined yet.
        size: (2,) entries in the queue, and the number of entries one step may add.
    """

    flat: Array
    climb: Array
    z: Array
    total: Array
    came: Rows
    done: Mask
    key: Array
    origin: Rows
    to: Rows
    by: Rows
    size: Rows


@compiled
def advance(net: Net, nodes: Nodes, search: Search, goal: Goal, left: int) -> tuple[int, int, int]:
    """Continue a search; return its status, the goal's state if found, and the remaining work.

    This is A* (Hart, Nilsson and Raphael, IEEE SSC 4(2), 1968). A path that is h long in the plane
    and climbs by v in all is at least hypot(h, v) long, and exactly so if its slope is even; the
    same holds for the rest to the goal. A segment is examined when no shorter one remains.

    Args:
        net: Blocks, corners and tangents.
        nodes: Corners and other points.
        search: State; updated.
        goal: Goal.
        left: Work allowed: number of boxes around rings, and of points, that may be examined.
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
            if nodes.of[i] == goal.point:
                return FOUND, i, left
            left -= _go_on(net, nodes, search, goal, i)
        elif not _beaten(nodes, search, to, key):
            if by < 0:
                left -= _look(net, nodes, search, goal, i, to)
            else:
                _come(nodes, search, goal, (i, to), net.graph.open[by])
    return MORE, -1, left


@subroutine
def _go_on(net: Net, nodes: Nodes, search: Search, goal: Goal, i: int) -> int:
    """Queue the segments that leave a state, and return how many points were examined.

    Corners are connected by the tangents of the graph; other points by all segments that leave a
    corner on one side.
    """
    corner, n, p = net.corner, len(net.corner.position), nodes.of[i]
    at = nodes.position[p]
    begin, count = 0, len(nodes.position)
    if p < n:
        begin = n
        for k in range(net.graph.first[p], net.graph.first[p + 1]):
            _offer(nodes, search, goal, i, net.graph.to[k], k)
            count += 1
    for q in range(begin, len(nodes.position)):
        if q < n:
            tangent = passes(at, nodes.position[q], corner.before[q], corner.after[q])
        else:
            tangent = p >= n or passes(nodes.position[q], at, corner.before[p], corner.after[p])
        if tangent and q != p:
            _offer(nodes, search, goal, i, q, -1)
    return count - begin


@subroutine
def _look(net: Net, nodes: Nodes, search: Search, goal: Goal, i: int, to: int) -> int:
    """Examine the segment from a state to a point; return an upper bound of its work."""
    p, n = nodes.of[i], len(net.corner.position)
    touches = (
        net.corner.block[p] if p < n else -1,
        net.corner.block[to] if to < n else -1,
    )
    heights = (nodes.open[i, 0], nodes.open[i, 1])
    free = openings(net.parts, net.span, nodes.position[p], nodes.position[to], heights, touches)
    for k in range(len(free)):
        _come(nodes, search, goal, (i, to), free[k])
    return 2 * len(net.parts.box)


@subroutine
def _offer(nodes: Nodes, search: Search, goal: Goal, i: int, to: int, by: int) -> None:
    """Queue the segment from a state to a point if it may lead to a shorter path."""
    a, b = nodes.position[nodes.of[i]], nodes.position[to]
    flat = search.flat[i] + math.hypot(b[0] - a[0], b[1] - a[1])
    ahead = flat - search.flat[i] + math.hypot(goal.x - b[0], goal.y - b[1])
    if goal.steep:
        key = search.flat[i] + math.hypot(ahead, search.z[i] - goal.z)
    else:
        key = math.hypot(search.flat[i] + ahead, search.climb[i] + abs(search.z[i] - goal.z))
    if key < goal.most and not _beaten(nodes, search, to, key):
        _push(search, key, i, to, by)


@subroutine
def _beaten(nodes: Nodes, search: Search, to: int, key: float) -> bool:
    """Whether no state of a point has a path longer than this, m."""
    for j in range(nodes.first[to], nodes.first[to + 1]):
        if not search.done[j] and search.total[j] > key + SHORTER:
            return False
    return True


@subroutine
def _come(nodes: Nodes, search: Search, goal: Goal, ends: tuple[int, int], heights: Array) -> None:
    """Record the segment from a state to a point, which is free at some heights."""
    i, to = ends
    a, b = nodes.position[nodes.of[i]], nodes.position[to]
    away = math.hypot(b[0] - a[0], b[1] - a[1])
    flat = search.flat[i] + away
    rest = math.hypot(goal.x - b[0], goal.y - b[1])
    for j in range(nodes.first[to], nodes.first[to + 1]):
        least = max(heights[0], nodes.open[i, 0], nodes.come[j, 0])
        greatest = min(heights[1], nodes.open[i, 1], nodes.come[j, 1])
        if search.done[j] or least > greatest or not _ends(nodes, goal, j):
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


@subroutine
def _ends(nodes: Nodes, goal: Goal, j: int) -> bool:
    """Whether a state is not at the goal's point, or is the one that reaches the goal."""
    return nodes.of[j] != goal.point or bool(
        nodes.open[j, 0] - SAME <= goal.z <= nodes.open[j, 1] + SAME
    )


@subroutine
def _push(search: Search, key: float, origin: int, to: int, by: int) -> None:
    k = search.size[0]
    search.size[0] += 1
    while k > 0:
        above = (k - 1) // 2
        if search.key[above] <= key:
            break
        _move(search, above, k)
        k = above
    search.key[k], search.origin[k], search.to[k], search.by[k] = key, origin, to, by


@subroutine
def _pop(search: Search) -> tuple[float, int, int, int]:
    """Remove the entry with the smallest bound from the queue."""
    top = search.key[0], search.origin[0], search.to[0], search.by[0]
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


@subroutine
def _move(search: Search, source: int, target: int) -> None:
    search.key[target], search.origin[target] = search.key[source], search.origin[source]
    search.to[target], search.by[target] = search.to[source], search.by[source]
