"""The pattern ``sweep``: parallel lanes, and then what they missed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core import Array, Estimate, Mask, Rows
from star_core.toolkit import timeout
from star_search.frontier import Frontier
from star_search.lanes import (
    Lane,
    angles,
    assign_sections,
    divide,
    from_nearer_end,
    length,
    parallel_lanes,
    tour,
)
from star_search.pattern import TOLERANCE, TURN_RATE, Waypoint
from star_search.search_space import SearchSpace

MAX_ANGLES: Final = 8  # directions of lanes to compare: of the area's longest sides
START_YAW_ERROR: Final = math.radians(30)  # from the lane's direction when a scout starts on it
MIN_LENGTH: Final = 0.02  # m: remaining length of a trimmed lane


@dataclass(slots=True)
class Leg:
    """A lane that a scout is on, or on its way to.

    Attributes:
        lane: Its remaining part.
        cells: Cells to see from it.
        along: Distance of each of them along the lane, m.
        until: Time at which to give it up, s.
        started: Whether the scout is on the lane.
    """

    lane: Lane
    cells: Rows
    along: Array
    until: float
    started: bool = False


class Sweep:
    """Divides lanes over the area among the scouts, which then visit what the lanes missed.

    The lanes are parallel to that side of the area that makes the tour shortest. A lane, or its
    end, from which nothing unseen can be seen is skipped. A scout that is done takes the lanes of
    one that left, or the last ones of the largest remaining share; when there are none, it visits
    what was missed, like the pattern `frontier`.

    Args:
        space: Where to search.
    """

    def __init__(self, space: SearchSpace) -> None:
        self._space = space
        self._missed = Frontier(space)
        self._share: dict[int, list[Lane]] = {}
        self._legs: dict[int, Leg] = {}
        view = space.views[space.rows[0]]
        self._near, self._far = view.near, view.far

    def begin(self, estimate: Estimate, rows: tuple[int, ...]) -> float:
        space = self._space
        self._missed.begin(estimate, rows)
        longest = 0.0
        position = estimate.position
        regions = {row: space.region_of(position[row]) for row in rows}
        for region in sorted(set(regions.values()) - {-1}):
            scouts = [row for row in rows if regions[row] == region]
            lanes = self._tour(region, position[scouts, :2].mean(axis=0))
            sections = assign_sections(divide(lanes, len(scouts)), position[scouts, :2])
            for row, section in zip(scouts, sections, strict=True):
                self._share[row] = section
                way = math.dist(position[row, :2], section[0].start) if section else 0.0
                turns = 2 * len(section) * (math.pi / 2) / TURN_RATE
                longest = max(longest, (way + length(section)) / space.speed + turns)
        return longest

    def waypoints(self, estimate: Estimate, rows: tuple[int, ...]) -> Mapping[int, Waypoint]:
        for missing_row in self._legs.keys() - set(rows):
            self._share[missing_row].insert(0, self._legs.pop(missing_row).lane)
        waypoints = {}
        for row in rows:
            waypoint = self._on_lane(row, estimate, rows)
            if waypoint is None:
                claimed = self._missed.claimed() | self._claimed()
                waypoint = self._missed.waypoint(row, estimate, claimed)
            else:
                self._missed.drop(row)
            if waypoint is not None:
                waypoints[row] = waypoint
        for missing_row in set(self._space.views) - set(rows):
            self._missed.drop(missing_row)
        return waypoints

    def _tour(self, region: int, start: Array) -> list[Lane]:
        """The shortest tour over one region."""
        space = self._space
        tours = [
            tour(
                parallel_lanes(space.area, space.regions[region], space.lane_spacing, angle), start
            )
            for angle in angles(space.area)[:MAX_ANGLES]
        ]
        turn = math.pi / TURN_RATE * space.speed  # m that a scout flies in the time of a U-turn
        return min(tours, key=lambda lanes: length(lanes) + turn * len(lanes))

    def _claimed(self) -> Mask:
        """(C + 1,) cells of the lanes that scouts are on."""
        claimed = np.zeros_like(self._space.coverage.required)
        for leg in self._legs.values():
            claimed[leg.cells] = True
        return claimed

    def _on_lane(self, row: int, estimate: Estimate, rows: tuple[int, ...]) -> Waypoint | None:
        """Waypoint of a scout on its lane, or on the next; None if there is no lane for it."""
        while True:
            leg = self._legs.get(row)
            if leg is None:
                leg = self._next(row, estimate, rows)
                if leg is None:
                    return None
                self._legs[row] = leg
            waypoint = self._along(leg, estimate.position[row], float(estimate.yaw[row]))
            if waypoint is not None and estimate.time <= leg.until:
                return waypoint
            del self._legs[row]

    def _along(self, leg: Leg, position: Array, yaw: float) -> Waypoint | None:
        """Waypoint on a lane; None at its end, or if nothing unseen is ahead."""
        start, end = leg.lane
        away = end - start
        direction = math.atan2(away[1], away[0])
        if not leg.started:
            way = start - position[:2]
            far = math.hypot(*way)
            steady = abs(math.remainder(direction - yaw, math.tau)) <= START_YAW_ERROR
            leg.started = far <= TOLERANCE and steady
            if not leg.started:
                ahead = far > TOLERANCE
                return Waypoint(
                    float(start[0]),
                    float(start[1]),
                    math.atan2(way[1], way[0]) if ahead else direction,
                )
        at = float((position[:2] - start) @ away) / max(leg.lane.length, 1e-9)
        if math.dist(position[:2], end) <= TOLERANCE or at >= leg.lane.length:
            return None
        ahead_left = self._space.coverage.unseen[leg.cells] & (leg.along > at + self._near)
        if not ahead_left.any():
            return None
        return Waypoint(float(end[0]), float(end[1]), direction)

    def _next(self, row: int, estimate: Estimate, rows: tuple[int, ...]) -> Leg | None:
        """Take the next lane from which something unseen can be seen."""
        while True:
            share = self._share.get(row) or self._taken_over(row, estimate, rows)
            if not share:
                return None
            self._share[row] = share
            leg = self._leg(share.pop(0), estimate, row)
            if leg is not None:
                return leg

    def _taken_over(self, row: int, estimate: Estimate, rows: tuple[int, ...]) -> list[Lane]:
        """Lanes for a scout that has none: of one that left, or half of the largest share."""
        region, position = self._space.region_of(estimate.position[row]), estimate.position[row, :2]
        same = {
            other: share
            for other, share in self._share.items()
            if share and self._space.region_of(share[0].start) == region
        }
        absent = [other for other in same if other not in rows]
        if absent:
            nearest = min(absent, key=lambda other: math.dist(same[other][0].start, position))
            return from_nearer_end(self._share.pop(nearest), position)
        largest = max(same, key=lambda other: length(same[other]), default=None)
        if largest is None:
            return []
        half = len(same[largest]) // 2 if len(same[largest]) > 1 else 0
        half_share, self._share[largest] = same[largest][half:], same[largest][:half]
        return from_nearer_end(half_share, position)

    def _leg(self, lane: Lane, estimate: Estimate, row: int) -> Leg | None:
        """Return a lane without ends that show nothing new; None if all of it shows nothing new."""
        coverage, spacing = self._space.coverage, self._space.lane_spacing
        ahead = (lane.end - lane.start) / lane.length
        offset = coverage.center - lane.start
        along = offset @ ahead
        across = np.abs(offset[:, 1] * ahead[0] - offset[:, 0] * ahead[1])
        on_lane = (across <= spacing / 2) & (along >= 0.0) & (along <= lane.length + self._far)
        cells = np.flatnonzero(on_lane & coverage.unseen[:-1])
        if not len(cells):
            return None
        spot = (self._near + self._far) / 2
        first = min(max(0.0, float(along[cells].min()) - spot), lane.length - MIN_LENGTH)
        trimmed = Lane(lane.start + max(0.0, first) * ahead, lane.end)
        way = math.dist(estimate.position[row, :2], trimmed.start) + trimmed.length
        takes = way / self._space.speed + math.tau / TURN_RATE
        return Leg(trimmed, cells, along[cells] - max(0.0, first), estimate.time + timeout(takes))
