"""The pattern ``frontier``: always to where the most unseen floor can be seen soonest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from star_core import Array, Estimate, Mask, Rows
from star_core.toolkit import timeout, wrap_angle
from star_search.area import MIN_IMAGES, FieldOfView
from star_search.pattern import TOLERANCE, TURN_RATE, Waypoint
from star_search.search_space import SearchSpace

YAW_TOLERANCE: Final = math.radians(15)  # heading error at which a scout sees its cells
TURN_DISTANCE: Final = 0.4  # m from its viewpoint where a scout turns to the viewpoint's heading
VIEW_TIME: Final = 1.0  # s per viewpoint besides its path: to brake, and for `MIN_IMAGES` images
MAX_TRIES: Final = 2  # viewpoints that should show a cell but did not, before it is given up
GAIN_EXPONENT: Final = 0.5
"""Of the number of cells in the value of a viewpoint; below 1, a few cells nearby are not postponed
until they are far away."""
MIN_REMAINING: Final = 0.3  # share of a viewpoint's cells below which another one is chosen


@dataclass(slots=True)
class Trip:
    """A scout on its way to a viewpoint.

    Attributes:
        viewpoint: Its row.
        cells: Cells to see from there.
        until: Time at which to give it up, s.
        arrival: Time of the scout's arrival, s; None before.
    """

    viewpoint: int
    cells: Rows
    until: float
    arrival: float | None = None


class Frontier:
    """Sends each scout to its most valuable viewpoint that no other scout has claimed.

    The value is the square root of the number of unseen cells visible from there, over the time
    that it takes to fly there and look. A viewpoint must show some of the frontier, the unseen
    cells adjacent to seen ones (Yamauchi, CIRA 1997), once anything was seen; cells that another
    scout is on its way to see do not count, as in the coordination of Burgard et al. (IEEE Trans.
    Robotics 21(3), 2005). A viewpoint is tried once, and a cell that was not seen from `MAX_TRIES`
    viewpoints is given up: so the search ends.

    Args:
        space: Where to search.
    """

    def __init__(self, space: SearchSpace) -> None:
        self._space = space
        alike = {view: Viewpoints(space, view) for view in dict.fromkeys(space.safe_views.values())}
        self._viewpoints = {row: alike[view] for row, view in space.safe_views.items()}
        self._trips: dict[int, Trip] = {}
        self._tries = np.zeros(space.coverage.outside + 1, np.int64)
        self._dwell = {
            row: (MIN_IMAGES + 2) / camera.rate
            for row in space.safe_views
            if (camera := space.scene.agents[row].camera) is not None
        }

    def begin(self, estimate: Estimate, rows: tuple[int, ...]) -> float:
        """Require only visible cells; return how long lanes would take, and a stop at each view."""
        coverage = self._space.coverage
        can: Mask = np.zeros_like(coverage.required)
        far = 0.0
        for row in rows:
            points = self._viewpoints[row]
            way = points.distance(estimate.position[row])
            can[points.cells[np.isfinite(way)]] = True
            far = max(far, float(way[np.isfinite(way)].max(initial=0.0)))
        coverage.required &= can
        ground = float(coverage.unseen.sum()) * coverage.cell**2 / len(rows)
        each = min(len(view.points) * view.cell**2 for view in self._space.views.values())
        return (
            far + ground / self._space.lane_spacing
        ) / self._space.speed + ground / each * VIEW_TIME

    def waypoints(self, estimate: Estimate, rows: tuple[int, ...]) -> Mapping[int, Waypoint]:
        for row in self._trips.keys() - set(rows):
            del self._trips[row]
        return {
            row: waypoint
            for row in rows
            if (waypoint := self.waypoint(row, estimate, self.claimed())) is not None
        }

    def claimed(self) -> Mask:
        """Return the cells that scouts are on their way to see, (C + 1,)."""
        claimed = np.zeros_like(self._space.coverage.required)
        for trip in self._trips.values():
            claimed[trip.cells] = True
        return claimed

    def drop(self, row: int) -> None:
        """Cancel a scout's trip."""
        self._trips.pop(row, None)

    def waypoint(self, row: int, estimate: Estimate, claimed: Mask) -> Waypoint | None:
        """Return the waypoint of one scout, to see unclaimed cells; None if there are none."""
        trip = self._trips.get(row)
        points = self._viewpoints[row]
        if trip is not None:
            self._follow(row, trip, estimate)
            trip = self._trips.get(row)
        if trip is None:
            trip = self._choose(row, estimate, claimed)
            if trip is None:
                return None
            self._trips[row] = trip
        x, y, yaw = points.pose[trip.viewpoint].tolist()
        return looking_ahead(estimate.position[row], x, y, yaw)

    def _follow(self, row: int, trip: Trip, estimate: Estimate) -> None:
        """End a trip that is over, or that has lost most of its value."""
        points, unseen_cells = self._viewpoints[row], self._space.coverage.unseen
        unseen = int(unseen_cells[trip.cells].sum())
        x, y, yaw = points.pose[trip.viewpoint].tolist()
        at = math.dist(estimate.position[row, :2], (x, y)) <= TOLERANCE
        aligned = abs(math.remainder(yaw - float(estimate.yaw[row]), math.tau)) <= YAW_TOLERANCE
        if at and aligned and trip.arrival is None:
            trip.arrival = estimate.time
        looked = trip.arrival is not None and estimate.time - trip.arrival >= self._dwell[row]
        if looked or estimate.time > trip.until:
            points.tried[trip.viewpoint] = True
            self._tries[trip.cells[unseen_cells[trip.cells]]] += 1
            self.drop(row)
        elif unseen == 0 or (trip.arrival is None and unseen < MIN_REMAINING * len(trip.cells)):
            self.drop(row)

    def _choose(self, row: int, estimate: Estimate, claimed: Mask) -> Trip | None:
        points, coverage = self._viewpoints[row], self._space.coverage
        candidates = coverage.unseen & ~claimed & (self._tries < MAX_TRIES)
        if not candidates.any():
            return None
        gain = candidates[points.cells].sum(axis=1)
        gain[points.tried] = 0
        edge = candidates & coverage.adjacent(coverage.seen)
        at_edge = edge[points.cells].any(axis=1)
        if (gain[at_edge] > 0).any():
            gain[~at_edge] = 0
        time = self._time(row, points, estimate)
        value = np.where(np.isfinite(time), gain**GAIN_EXPONENT / (time + VIEW_TIME), 0.0)
        if not (value > 0).any():
            return None
        best = int(np.argmax(value))
        cells = np.unique(points.cells[best])
        return Trip(best, cells[candidates[cells]], estimate.time + timeout(float(time[best])))

    def _time(self, row: int, points: Viewpoints, estimate: Estimate) -> Array:
        """(V,) time of a scout to each viewpoint, s."""
        way = points.distance(estimate.position[row])
        turn = np.abs(wrap_angle(points.pose[:, 2] - estimate.yaw[row]))
        time: Array = way / self._space.speed + turn / TURN_RATE
        return time


def looking_ahead(position: Array, x: float, y: float, yaw: float) -> Waypoint:
    """Return a waypoint with the heading of flight, and near its end a given heading."""
    dx, dy = x - float(position[0]), y - float(position[1])
    return Waypoint(x, y, math.atan2(dy, dx) if math.hypot(dx, dy) > TURN_DISTANCE else yaw)


SPACING: Final = 2  # cells between neighbouring positions
HEADINGS: Final = 8


class Viewpoints:
    """All positions of a lattice from which the area can be seen, with some headings each.

    Paths lead from each position to its eight neighbours.

    Args:
        space: Where to search.
        view: What the scouts see reliably.

    Attributes:
        pose: (V, 3) x, y and yaw, map frame, m and rad.
        cells: (V, M) cells of the coverage map that are seen from each, or its `outside`.
        node: (V,) row in the lattice.
        tried: (V,) viewpoints at which a scout looked, or which it gave up.
    """

    def __init__(self, space: SearchSpace, view: FieldOfView) -> None:
        self._position, self._links = _lattice(space)
        yaw = np.arange(HEADINGS) * math.tau / HEADINGS
        near = shapely.dwithin(space.area, shapely.points(self._position), view.reach)
        at = np.flatnonzero(near)
        node: Rows = np.repeat(at, HEADINGS)
        pose: Array = np.column_stack([self._position[node], np.tile(yaw, len(at))])
        cells = space.coverage.visible(view, pose)
        useful = space.coverage.required[cells].any(axis=1)
        self.pose, self.cells, self.node = pose[useful], cells[useful], node[useful]
        self.tried = np.zeros(len(self.pose), np.bool_)

    def distance(self, position: Array) -> Array:
        """(V,) length of the path from a position to each viewpoint, m; inf if there is none."""
        if not len(self._position):
            return np.zeros(0)
        start = int(np.argmin(((self._position - position[:2]) ** 2).sum(axis=1)))
        lengths: Array = dijkstra(self._links, directed=False, indices=np.array([start]))
        length: Array = lengths[0, self.node]
        return length


def _lattice(space: SearchSpace) -> tuple[Array, csr_array]:
    """Positions where an agent may be, (P, 2), m, and the distances between neighbours."""
    step = SPACING * space.coverage.cell
    if not space.regions:
        return np.zeros((0, 2)), csr_array((0, 0))
    west, south, east, north = shapely.total_bounds(space.regions)
    x, y = np.arange(west, east, step) + 1e-6, np.arange(south, north, step) + 1e-6
    free = np.zeros((len(x) + 2, len(y) + 2), np.bool_)  # with a border that is not free
    for region in space.regions:
        shapely.prepare(region)
        free[1:-1, 1:-1] |= shapely.contains_xy(region, *np.meshgrid(x, y, indexing="ij"))
    number = np.cumsum(free).reshape(free.shape) - 1
    i, j = np.nonzero(free)
    begins, ends, lengths = [], [], []
    for di, dj in ((0, 1), (1, -1), (1, 0), (1, 1)):
        passable = free[i + di, j + dj]
        begins.append(number[i, j][passable])
        ends.append(number[i + di, j + dj][passable])
        lengths.append(np.full(passable.sum(), step * math.hypot(di, dj)))
    links = csr_array(
        (np.concatenate(lengths), (np.concatenate(begins), np.concatenate(ends))),
        shape=(len(i), len(i)),
    )
    return np.column_stack([x[i - 1], y[j - 1]]), links
