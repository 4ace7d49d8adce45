"""The visibility graph of a world, and shortest paths through it."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from star_core import Array, Fence, Mask, Rows
from star_visibility.line_of_sight import sees
from star_visibility.nodes import joined, nodes, portals
from star_visibility.openings import entered
from star_visibility.profile import profile
from star_visibility.regions import Block, Regions, apart
from star_visibility.search import FOUND, FULL, MORE, Goal, Net, Nodes, Search, advance
from star_visibility.tangents import corners, graph

DETOUR = 1.2  # times the straight distance: portals are tried too for paths longer than this
STEEP = 1.02  # times the estimated length: a path longer than this is searched again
BEGIN = 5000  # cost of starting a search, in the unit of `Work`
STRAIGHT = 1e-9  # m; a point nearer than this to the line between its neighbours is not a turn


@dataclass(slots=True)
class Work:
    """The remaining computation budget; searches draw from it, and pause when it is used up.

    Attributes:
        left: Number of boxes around rings, and of points, that may still be examined.
    """

    left: int


Flat: TypeAlias = tuple[Array, Array, Mask]
"""(M, 2) points of a polyline in the plane, m; (M - 1,) a free height of each segment, m; and (M,)
whether the polyline turns around a corner there."""

Candidate: TypeAlias = tuple[float, Array, Flat]
"""Length of a path, m; (K, 3) its points, m; and its polyline in the plane."""


class Network:
    """Finds paths between free positions.

    A path is a polyline in the plane that turns at corners of obstacles, and heights along it: the
    smallest that clear what the polyline passes over and under, climbing as evenly as possible. It
    can change from passing over to passing under where the straight line, or a line between two
    corners of the path, meets an obstacle; and if that gives no path, or a long one, at portals on
    all outlines. The shortest of the paths found is returned.

    Args:
        blocks: Regions that paths stay out of.
        planned: The same, in height bands.
        height: Lowest and highest flight height z, m.
        fence: Paths turn only inside it.
    """

    def __init__(
        self, blocks: list[Block], planned: Regions, height: tuple[float, float], fence: Fence
    ) -> None:
        self._planned = planned
        self._height = height
        self._parts = apart(blocks)
        self._span = np.array([block[:2] for block in blocks], np.float64).reshape(-1, 2)
        self._passed = [k for k, block in enumerate(blocks) if block[:2] != height]
        corner = corners(self._parts, fence)
        tangents = graph(self._parts, self._span, corner)
        self._net = Net(self._parts, self._span, corner, tangents)
        self._plain = self._nodes(corner.position, corner.block)
        portal = portals(blocks, height, fence)
        self._portals = self._nodes(portal) if len(portal) else None
        low, high = (np.array([*end[:2], z]) for end, z in
                     zip((fence.low, fence.high), height, strict=True))  # fmt: skip
        self._warm_up(low.astype(np.float64), high.astype(np.float64))

    def path(self, start: Array, end: Array, work: Work) -> Generator[None, None, Array | None]:
        """Return the (K, 3) points of a path including both ends, m; None if there is none.

        Yields whenever the work is used up.
        """
        if sees(self._planned, start, end):
            return np.array([start, end])
        forward = tuple(start.tolist()) <= tuple(end.tolist())  # the same path in both directions
        way = yield from self._path(*((start, end) if forward else (end, start)), work)
        return way if way is None or forward else way[::-1].copy()

    def _path(self, start: Array, end: Array, work: Work) -> Generator[None, None, Array | None]:
        met = self._met(np.array([start[:2], end[:2]]))
        best = yield from self._tried(self._plain, start, end, met, math.inf, work)
        if self._portals is None or (best and best[0] <= DETOUR * math.dist(start, end)):
            return best[1] if best else None
        every, least = joined(self._plain, self._portals), best[0] if best else math.inf
        other = yield from self._tried(every, start, end, met, least, work)
        while other and other[0] < least - STRAIGHT:
            best, least = other, other[0]
            line, _, turns = other[2]
            turns[[0, -1]] = True
            more = np.concatenate([self._met(line[turns]), line[~turns]])
            other = yield from self._tried(self._plain, start, end, more, least, work)
        return best[1] if best else None

    def _tried(
        self, base: Nodes, start: Array, end: Array, more: Array, most: float, work: Work
    ) -> Generator[None, None, Candidate | None]:
        """Search for the shortest path, also by extra points; None if none is below `most`, m.

        If it cannot climb as evenly as the search assumed, the search is repeated as if no path
        could, and the shorter of both is returned.
        """
        best: Candidate | None = None
        for steep in (False, True):
            flat = yield from self._flat(base, (start, end), more, most, work, steep=steep)
            if flat is None:
                break
            way = self._whole(flat[0], start, end)
            length = _length(way)
            if best is None or length < best[0]:
                best = length, way, flat[0]
            if length <= STEEP * flat[1]:
                break
        return best

    def _flat(
        self,
        base: Nodes,
        ends: tuple[Array, Array],
        more: Array,
        most: float,
        work: Work,
        *,
        steep: bool,
    ) -> Generator[None, None, tuple[Flat, float] | None]:
        """Search for the shortest polyline, and return it with the length the search assumes."""
        start, end = ends
        all_nodes = joined(base, self._nodes(np.concatenate([[start[:2], end[:2]], more])))
        first, z = len(base.position), min(max(float(end[2]), self._height[0]), self._height[1])
        goal = Goal(first + 1, float(end[0]), float(end[1]), z, most, steep)
        search = self._begin(all_nodes, first, start, end)
        work.left -= BEGIN
        while True:
            if work.left <= 0:
                yield
            how, state, work.left = advance(self._net, all_nodes, search, goal, work.left)
            if how == FULL:
                search = _longer(search)
            elif how == FOUND:
                line = _line(all_nodes, search, int(state), len(self._net.corner.position))
                return line, float(search.total[state])
            elif how != MORE:
                return None

    def _begin(self, all_nodes: Nodes, first: int, start: Array, end: Array) -> Search:
        states, z = len(all_nodes.of), float(np.clip(start[2], *self._height))
        most = int(np.diff(self._net.graph.first).max(initial=0)) + len(all_nodes.position) + states
        zero, count = np.zeros(states), np.array([0, most])
        search = Search(
            zero, zero.copy(), zero.copy(), np.full(states, np.inf), np.full(states, -1),
            np.zeros(states, np.bool_), np.empty(4 * most), np.empty(4 * most, np.int64),
            np.empty(4 * most, np.int64), np.empty(4 * most, np.int64), count,
        )  # fmt: skip
        for state in range(all_nodes.first[first], all_nodes.first[first + 1]):
            low, high = all_nodes.open[state]
            if low - STRAIGHT <= z <= high + STRAIGHT:
                search.z[state], search.total[state] = z, math.dist(start, end)
                k = count[0]
                search.key[k], search.origin[k], search.to[k] = 0.0, state, -1
                count[0] += 1
                break
        return search

    def _whole(self, flat: Flat, start: Array, end: Array) -> Array:
        line, leg, turns = flat
        least, most = self._height
        low, high = (min(max(float(z), least), most) for z in (start[2], end[2]))
        way = profile(self._parts, self._span, line, leg, (low, high))
        if len(way) > len(line) or not turns[1:-1].all():
            way = _turns(way)
        above = [start[None]] if start[2] != low else []
        below = [end[None]] if end[2] != high else []
        return np.concatenate([*above, way, *below])

    def _nodes(self, position: Array, block: Rows | None = None) -> Nodes:
        corner_block: Rows = np.full(len(position), -1) if block is None else block
        return nodes(self._parts, self._span, self._height, position, corner_block)

    def _met(self, line: Array) -> Array:
        """(K, 2) points where a line enters or leaves what it can fly over or under, m."""
        points = [np.empty((0, 2))]
        for a, b in pairwise(line):
            length = math.dist(a, b)
            for part in self._passed:
                ends = entered(self._parts, part, *a, *b)
                inner = ends[(ends > STRAIGHT) & (ends < length - STRAIGHT)]
                points.append(a + inner[:, None] * (b - a) / max(length, STRAIGHT))
        return np.concatenate(points)

    def _warm_up(self, low: Array, high: Array) -> None:
        """Compile the kernels used in flight, or load them from the cache, before take-off."""
        sees(self._planned, low, high)
        entered(self._parts, 0, *low[:2], *high[:2]) if len(self._span) else None
        for _ in self._path(low, high, Work(10_000)):
            break
        flat = np.array([low[:2], high[:2]])
        profile(self._parts, self._span, flat, low[2:], (low[2], low[2]))


def _line(all_nodes: Nodes, search: Search, state: int, corner_count: int) -> Flat:
    chain = [state]
    while search.came[chain[-1]] >= 0:
        chain.append(int(search.came[chain[-1]]))
    chain.reverse()
    at = all_nodes.of[chain]
    return all_nodes.position[at], search.z[chain[1:]], at < corner_count


def _longer(search: Search) -> Search:
    key, origin, to, by = (np.concatenate([row, np.empty_like(row)]) for row in
                        (search.key, search.origin, search.to, search.by))  # fmt: skip
    return search._replace(key=key, origin=origin, to=to, by=by)


def _turns(way: Array) -> Array:
    """Return a path without the points at which it does not turn."""
    kept: list[Array] = [way[0]]
    for point, following in pairwise(way[1:]):
        along, off = following - kept[-1], point - kept[-1]
        size = float(np.sqrt((along**2).sum()))
        aside = off - along * float(off @ along) / max(size, STRAIGHT) ** 2
        if float(np.sqrt((aside**2).sum())) > STRAIGHT:
            kept.append(point)
    return np.array([*kept, way[-1]])


def _length(way: Array) -> float:
    return float(np.sqrt((np.diff(way, axis=0) ** 2).sum(axis=1)).sum())
