"""The pattern ``sweep``: lanes side by side, and then what they missed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core import Array, Estimate, Mask, Rows, timeout
from star_search.field import Field
from star_search.frontier import Frontier
from star_search.lanes import Lane, angles, length, strips, tour
from star_search.pattern import Aim
from star_search.sharing import cut, hand_out, turned
from star_search.timing import NEAR, TURN_RATE

ANGLES: Final = 8  # directions that are tried: of the area's longest sides
STEADY: Final = math.radians(30)  # rad off its lane's direction a scout sets out on it


@dataclass(slots=True)
class Leg:
    """A lane that a scout is on, or on its way to.

    Attributes:
        lane: What is left of it.
        cells: Those it is to show.
        along: How far along the lane each of them is, m.
        until: When to give it up, s.
        on: Whether the scout is on the lane.
    """

    lane: Lane
    cells: Rows
    along: Array
    until: float
    on: bool = False


class Sweep:
    """Shares lanes over the area among the scouts, and has what they miss looked at afterwards.

    The lanes lie along that side of the area that makes the tour shortest. A lane, or its end, of
    which all was seen already is left out. A scout that is done takes lanes of one that left, or
    else the last ones of whom has most left; when there are none, it goes to what was missed, as
    with the pattern `frontier`.

    Args:
        field: Where to search.
    """

    def __init__(self, field: Field) -> None:
        self._field = field
        self._rest = Frontier(field)
        self._share: dict[int, list[Lane]] = {}
        self._legs: dict[int, Leg] = {}
        view = field.views[field.rows[0]]
        self._near, self._far = view.near, view.far

    def begin(self, estimate: Estimate, rows: tuple[int, ...]) -> float:
        field = self._field
        self._rest.begin(estimate, rows)
        longest = 0.0
        position = estimate.position
        parts = {row: field.part_of(position[row]) for row in rows}
        for part in sorted(set(parts.values()) - {-1}):
            mine = [row for row in rows if parts[row] == part]
            lanes = self._lanes(part, position[mine, :2].mean(axis=0))
            pieces = hand_out(cut(lanes, len(mine)), position[mine, :2])
            for row, piece in zip(mine, pieces, strict=True):
                self._share[row] = piece
                way = math.dist(position[row, :2], piece[0].start) if piece else 0.0
                turns = 2 * len(piece) * (math.pi / 2) / TURN_RATE
                longest = max(longest, (way + length(piece)) / field.speed + turns)
        return longest

    def lead(self, estimate: Estimate, rows: tuple[int, ...]) -> Mapping[int, Aim]:
        for gone in self._legs.keys() - set(rows):
            self._share[gone].insert(0, self._legs.pop(gone).lane)
        aims = {}
        for row in rows:
            aim = self._on_lane(row, estimate, rows)
            if aim is None:
                aim = self._rest.aim(row, estimate, self._rest.claimed() | self._claimed())
            else:
                self._rest.drop(row)
            if aim is not None:
                aims[row] = aim
        for gone in set(self._field.views) - set(rows):
            self._rest.drop(gone)
        return aims

    def _lanes(self, part: int, start: Array) -> list[Lane]:
        """The shortest tour over one part of the field."""
        field = self._field
        tours = [
            tour(strips(field.area, field.parts[part], field.swath, angle), start)
            for angle in angles(field.area)[:ANGLES]
        ]
        turn = math.pi / TURN_RATE * field.speed  # m, as long as it takes to turn about
        return min(tours, key=lambda lanes: length(lanes) + turn * len(lanes))

    def _claimed(self) -> Mask:
        """(C + 1,) cells of the lanes that scouts are on."""
        claimed = np.zeros_like(self._field.chart.wanted)
        for leg in self._legs.values():
            claimed[leg.cells] = True
        return claimed

    def _on_lane(self, row: int, estimate: Estimate, rows: tuple[int, ...]) -> Aim | None:
        """Where a scout should go on its lane, or on the next; None if there is no lane for it."""
        while True:
            leg = self._legs.get(row)
            if leg is None:
                leg = self._next(row, estimate, rows)
                if leg is None:
                    return None
                self._legs[row] = leg
            aim = self._along(leg, estimate.position[row], float(estimate.yaw[row]))
            if aim is not None and estimate.time <= leg.until:
                return aim
            del self._legs[row]

    def _along(self, leg: Leg, position: Array, yaw: float) -> Aim | None:
        """Where to go on a lane; None at its end, or where nothing ahead is left to be seen."""
        start, end = leg.lane
        away = end - start
        direction = math.atan2(away[1], away[0])
        if not leg.on:
            way = start - position[:2]
            far = math.hypot(*way)
            steady = abs(math.remainder(direction - yaw, math.tau)) <= STEADY
            leg.on = far <= NEAR and steady
            if not leg.on:
                ahead = far > NEAR
                return Aim(
                    float(start[0]),
                    float(start[1]),
                    math.atan2(way[1], way[0]) if ahead else direction,
                )
        at = float((position[:2] - start) @ away) / max(leg.lane.length, 1e-9)
        if math.dist(position[:2], end) <= NEAR or at >= leg.lane.length:
            return None
        ahead_left = self._field.chart.left[leg.cells] & (leg.along > at + self._near)
        if not ahead_left.any():
            return None
        return Aim(float(end[0]), float(end[1]), direction)

    def _next(self, row: int, estimate: Estimate, rows: tuple[int, ...]) -> Leg | None:
        """Take the next lane on which there is something to see."""
        while True:
            share = self._share.get(row) or self._taken(row, estimate, rows)
            if not share:
                return None
            self._share[row] = share
            leg = self._leg(share.pop(0), estimate, row)
            if leg is not None:
                return leg

    def _taken(self, row: int, estimate: Estimate, rows: tuple[int, ...]) -> list[Lane]:
        """Lanes for a scout that has none: of one that left, or half of whom has most."""
        part, here = self._field.part_of(estimate.position[row]), estimate.position[row, :2]
        same = {
            other: share
            for other, share in self._share.items()
            if share and self._field.part_of(share[0].start) == part
        }
        left = [other for other in same if other not in rows]
        if left:
            nearest = min(left, key=lambda other: math.dist(same[other][0].start, here))
            return self._turned(self._share.pop(nearest), here)
        most = max(same, key=lambda other: length(same[other]), default=None)
        if most is None:
            return []
        half = len(same[most]) // 2 if len(same[most]) > 1 else 0
        mine, self._share[most] = same[most][half:], same[most][:half]
        return self._turned(mine, here)

    def _turned(self, lanes: list[Lane], here: Array) -> list[Lane]:
        nearer_end = math.dist(lanes[-1].end, here) < math.dist(lanes[0].start, here)
        return turned(lanes) if nearer_end else lanes

    def _leg(self, lane: Lane, estimate: Estimate, row: int) -> Leg | None:
        """Return a lane without those ends from which nothing new is seen; None if nothing is."""
        chart, swath = self._field.chart, self._field.swath
        ahead = (lane.end - lane.start) / lane.length
        offset = chart.middle - lane.start
        along = offset @ ahead
        across = np.abs(offset[:, 1] * ahead[0] - offset[:, 0] * ahead[1])
        beyond = self._far  # what lies behind the lane's end, and is seen from it
        mine = (across <= swath / 2) & (along >= 0.0) & (along <= lane.length + beyond)
        cells = np.flatnonzero(mine & chart.left[:-1])
        if not len(cells):
            return None
        spot = (self._near + self._far) / 2
        first = min(max(0.0, float(along[cells].min()) - spot), lane.length - SHORT)
        trimmed = Lane(lane.start + max(0.0, first) * ahead, lane.end)
        way = math.dist(estimate.position[row, :2], trimmed.start) + trimmed.length
        takes = way / self._field.speed + math.tau / TURN_RATE
        return Leg(trimmed, cells, along[cells] - max(0.0, first), estimate.time + timeout(takes))


SHORT: Final = 0.02  # m that is left of a lane at least
