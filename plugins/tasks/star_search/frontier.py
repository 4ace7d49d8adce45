"""The pattern ``frontier``: always to where most that was not seen can be seen soonest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core import Array, Estimate, Mask, Rows, timeout, wrap_angle
from star_search.field import Field
from star_search.pattern import Aim
from star_search.timing import NEAR, TURN_RATE
from star_search.view import LOOKS
from star_search.viewpoints import Viewpoints

ALIGNED: Final = math.radians(15)  # rad off its heading a scout looks where it should
ALONG: Final = 0.4
"""m from its viewpoint a scout turns to the viewpoint's heading; before, it looks ahead."""

SETTLING: Final = 1.0  # s that each viewpoint costs beside its way: to brake, and for `LOOKS` looks
TRIES: Final = 2
"""Viewpoints from which a cell was not seen, though it should be, before it is given up."""

GREED: Final = 0.5
"""Power of the number of cells in the worth: with less of it few cells near by are not left for
later, when they are far away."""

WORTH: Final = 0.3
"""Share of what was to be seen from a viewpoint below which another one is looked for."""


@dataclass(slots=True)
class Trip:
    """A scout on its way to a viewpoint.

    Attributes:
        viewpoint: Its row.
        cells: What is to be seen from there.
        until: When to give it up, s.
        there: Since when the scout looks from it, s; None before.
    """

    viewpoint: int
    cells: Rows
    until: float
    there: float | None = None


class Frontier:
    """Sends each scout to the viewpoint that is worth most to it, and that no other has claimed.

    The worth is the square root of the number of cells still to be seen from there, over the time
    that it takes to get there and look. A viewpoint must show some of the frontier, which are the
    unseen cells beside seen ones (Yamauchi, CIRA 1997), once anything was seen; and cells that
    another scout is on its way to see count for nothing, as in the coordination of Burgard et al.
    (IEEE Trans. Robotics 21(3), 2005). A viewpoint that was tried is not tried again, nor is a cell
    looked for again that was not seen from `TRIES` of them: so an end is sure.

    Args:
        field: Where to search.
    """

    def __init__(self, field: Field) -> None:
        self._field = field
        alike = {one: Viewpoints(field, one) for one in dict.fromkeys(field.outlooks.values())}
        self._viewpoints = {row: alike[one] for row, one in field.outlooks.items()}
        tried = {one: np.zeros(len(points.place), np.bool_) for one, points in alike.items()}
        self._tried = {row: tried[one] for row, one in field.outlooks.items()}
        self._trips: dict[int, Trip] = {}
        self._tries = np.zeros(field.chart.nowhere + 1, np.int64)
        self._dwell = {
            row: (LOOKS + 2) / camera.rate
            for row in field.outlooks
            if (camera := field.scene.agents[row].camera) is not None
        }

    def begin(self, estimate: Estimate, rows: tuple[int, ...]) -> float:
        """Want only what can be seen; return how long lanes would take, and a look at each view."""
        chart = self._field.chart
        can: Mask = np.zeros_like(chart.wanted)
        far = 0.0
        for row in rows:
            points = self._viewpoints[row]
            way = points.distance(estimate.position[row])
            can[points.cells[np.isfinite(way)]] = True
            far = max(far, float(way[np.isfinite(way)].max(initial=0.0)))
        chart.wanted &= can
        ground = float(chart.left.sum()) * chart.cell**2 / len(rows)
        each = min(len(one.points) * one.cell**2 for one in self._field.views.values())
        return (far + ground / self._field.swath) / self._field.speed + ground / each * SETTLING

    def lead(self, estimate: Estimate, rows: tuple[int, ...]) -> Mapping[int, Aim]:
        for row in self._trips.keys() - set(rows):
            del self._trips[row]
        return {
            row: aim for row in rows if (aim := self.aim(row, estimate, self.claimed())) is not None
        }

    def claimed(self) -> Mask:
        """Return the cells that scouts are on their way to see, (C + 1,)."""
        claimed = np.zeros_like(self._field.chart.wanted)
        for trip in self._trips.values():
            claimed[trip.cells] = True
        return claimed

    def drop(self, row: int) -> None:
        """Let a scout have no viewpoint to go to."""
        self._trips.pop(row, None)

    def aim(self, row: int, estimate: Estimate, claimed: Mask) -> Aim | None:
        """Return where one scout should go to see what is not claimed; None if there is nothing."""
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
        """End a trip that is over, or that is worth little by now."""
        points, left = self._viewpoints[row], self._field.chart.left
        unseen = int(left[trip.cells].sum())
        x, y, yaw = points.pose[trip.viewpoint].tolist()
        at = math.dist(estimate.position[row, :2], (x, y)) <= NEAR
        aligned = abs(math.remainder(yaw - float(estimate.yaw[row]), math.tau)) <= ALIGNED
        if at and aligned and trip.there is None:
            trip.there = estimate.time
        looked = trip.there is not None and estimate.time - trip.there >= self._dwell[row]
        if looked or estimate.time > trip.until:
            self._tried[row][trip.viewpoint] = True
            self._tries[trip.cells[left[trip.cells]]] += 1
            self.drop(row)
        elif unseen == 0 or (trip.there is None and unseen < WORTH * len(trip.cells)):
            self.drop(row)

    def _choose(self, row: int, estimate: Estimate, claimed: Mask) -> Trip | None:
        points, chart = self._viewpoints[row], self._field.chart
        left = chart.left & ~claimed & (self._tries < TRIES)
        if not left.any():
            return None
        gain = left[points.cells].sum(axis=1)
        gain[self._tried[row]] = 0
        edge = left & chart.beside(chart.seen)
        at_edge = edge[points.cells].any(axis=1)
        if (gain[at_edge] > 0).any():
            gain[~at_edge] = 0
        time = self._time(row, points, estimate)
        worth = np.where(np.isfinite(time), gain**GREED / (time + SETTLING), 0.0)
        if not (worth > 0).any():
            return None
        best = int(np.argmax(worth))
        cells = np.unique(points.cells[best])
        return Trip(best, cells[left[cells]], estimate.time + timeout(float(time[best])))

    def _time(self, row: int, points: Viewpoints, estimate: Estimate) -> Array:
        """(V,) how long a scout takes to each viewpoint, s."""
        way = points.distance(estimate.position[row])
        turn = np.abs(wrap_angle(points.pose[:, 2] - estimate.yaw[row]))
        time: Array = way / self._field.speed + turn / TURN_RATE
        return time


def looking_ahead(position: Array, x: float, y: float, yaw: float) -> Aim:
    """Return an aim with which a scout looks where it flies, and near its end to a heading."""
    dx, dy = x - float(position[0]), y - float(position[1])
    return Aim(x, y, math.atan2(dy, dx) if math.hypot(dx, dy) > ALONG else yaw)
