"""The visibility graphs of all bands of heights, and the shortest path through them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise, product

import numpy as np

from star_core import Array, Fence
from star_visibility.escape import BEYOND
from star_visibility.search import shortest
from star_visibility.sight import band_of, meeting, open_in, sees, within
from star_visibility.slopes import met, sloped
from star_visibility.tangents import graph, seen_from
from star_visibility.walls import Walls

DIRECTIONS = 8  # in which a way out from under an obstacle is looked for, besides the goal's
PAIRS = 24  # ways out from over or under obstacles, of start and goal, that are tried together


class Network:
    """Finds paths between free places. What is slow is done when it is made.

    A path crosses in one band of heights: up or down to the nearest height of the band, around what
    is in the way there, and up or down to its end. If an obstacle is above or below an end, the
    path may first come out from under it in another band. Of all these the shortest is taken.

    Args:
        walls: What paths stay out of.
        fence: Paths turn inside of it only.
    """

    def __init__(self, walls: Walls, fence: Fence) -> None:
        self._walls = walls
        self._bands = range(len(walls.level) - 1)
        self._graphs = [graph(walls, band, fence) for band in self._bands]
        self._warm_up(np.array(fence.low, np.float64), np.array(fence.high, np.float64))

    def path(self, start: Array, end: Array) -> Array | None:
        """Return the (K, 3) points of a path with both its ends, m; None if none is found."""
        if sees(self._walls, start, end):
            return np.array([start, end])
        best: Array | None = None
        doors = list(product(self._doors(start, end), self._doors(end, start)))
        pairs = [
            (math.dist(start, leave) + math.dist(leave, come) + math.dist(come, end), i)
            for i, (leave, come) in enumerate(doors)
        ]
        known: dict[tuple[float, ...], Array | None] = {}
        for bound, i in sorted(pairs)[:PAIRS]:
            if best is not None and bound >= _length(best):
                break
            legs = []
            for leg in pairwise([start, *doors[i], end]):
                key = (*leg[0].tolist(), *leg[1].tolist())
                if key not in known:
                    known[key] = leg[0][None] if math.dist(*leg) == 0.0 else self._crossing(*leg)
                if (way := known[key]) is None:
                    break
                legs.append(way)
            else:
                whole = np.concatenate(legs)
                best = whole if best is None or _length(whole) < _length(best) else best
        return best

    def _crossing(self, start: Array, end: Array) -> Array | None:
        """The shortest path that crosses in one band; None if there is none."""
        return min(self._crossings(start, end), key=_length, default=None)

    def _crossings(self, start: Array, end: Array) -> Iterator[Array]:
        """Paths through one band each; those that cannot be the shortest are left out."""
        apart = math.dist(start[:2], end[:2])
        z = [np.clip([start[2], end[2]], *ends) for ends in pairwise(self._walls.level)]
        bound = [
            math.hypot(apart, abs(up - start[2]) + abs(down - up) + abs(end[2] - down))
            for up, down in z
        ]
        least = math.inf
        for band in np.argsort(bound, kind="stable").tolist():
            if bound[band] >= least:
                return
            way = self._through(band, start, end, *z[band].tolist())
            if way is not None:
                least = min(least, _length(way))
                yield way

    def _through(
        self, band: int, start: Array, end: Array, first: float, last: float
    ) -> Array | None:
        """The shortest path in one band, from one height to another; None if there is none."""
        up, down = np.array([*start[:2], first]), np.array([*end[:2], last])
        for place, beside in ((start, up), (end, down)):
            if within(self._walls, band, *place[:2]) or not sees(self._walls, place, beside):
                return None
        flat = np.array([start[:2], end[:2]])
        if not open_in(self._walls, band, *start[:2], *end[:2]):
            turns = self._turns(band, start[:2], end[:2])
            if not len(turns):
                return None
            flat = np.concatenate([flat[:1], turns, flat[1:]])
        return sloped(self._walls, band, flat, (start[2], first, last, end[2]))

    def _turns(self, band: int, start: Array, end: Array) -> Array:
        """(K, 2) corners that the shortest path in one band turns at, m; none if there is none."""
        net = self._graphs[band]
        leave, come = (
            seen_from(self._walls, band, net.corner, net.before, net.after, place)
            for place in (start, end)
        )
        return net.corner[shortest(net.corner, net.first, net.to, net.length, leave, come, end)]

    def _warm_up(self, low: Array, high: Array) -> None:
        """Have what is called below compiled, or fetched from disk, before anybody flies."""
        self._turns(0, low[:2], high[:2])
        sees(self._walls, low, high)
        within(self._walls, 0, *low[:2])
        open_in(self._walls, 0, *low[:2], *high[:2])
        meeting(self._walls, 0, low[0], low[1], high[0], high[1], False)  # noqa: FBT003
        met(self._walls, 0, 0, np.array([low[:2], high[:2]]))
        band_of(self._walls, low[2])

    def _doors(self, place: Array, towards: Array) -> list[Array]:
        """A place, and those at its height that are straight out from all that is above or below.

        One is on the way to another place; the others lie in `DIRECTIONS` all around.
        """
        over = [band for band in self._bands if within(self._walls, band, *place[:2])]
        doors = [place]
        far = float(np.ptp(self._walls.corner)) if len(self._walls.corner) else 0.0
        bearing = math.atan2(towards[1] - place[1], towards[0] - place[0])
        angles = [bearing, *(math.tau * i / DIRECTIONS for i in range(DIRECTIONS))]
        for angle in angles if over else ():
            ray = np.array([math.cos(angle), math.sin(angle)])
            (x, y), (far_x, far_y) = place[:2], place[:2] + far * ray
            out = max(meeting(self._walls, b, x, y, far_x, far_y, False) for b in over)  # noqa: FBT003
            if out < math.inf:
                door = np.array([*(place[:2] + (out + BEYOND) * ray), place[2]])
                if not any(within(self._walls, band, *door[:2]) for band in over):
                    doors.append(door)
        return doors


def _length(way: Array) -> float:
    return float(np.sqrt((np.diff(way, axis=0) ** 2).sum(axis=1)).sum())
