"""Lanes side by side over an area with holes, a tour along them, and its division among scouts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment
from shapely import LineString, Polygon
from shapely.affinity import rotate
from shapely.geometry.base import BaseGeometry

from star_core import Array

MIN_LANE: Final = 0.05  # m: length of the shortest lane
MARGIN: Final = 1e-3  # m, of lanes from the border of where agents may be


class Lane(NamedTuple):
    """A straight segment to fly, from one end to the other.

    Attributes:
        start: (2,) map frame, m.
        end: (2,) map frame, m.
    """

    start: Array
    end: Array

    @property
    def length(self) -> float:
        """From end to end, m."""
        return math.dist(self.start, self.end)

    def reversed(self) -> Lane:
        """Return the lane in the opposite direction."""
        return Lane(self.end, self.start)


def parallel_lanes(
    area: BaseGeometry, free: BaseGeometry, spacing: float, angle: float
) -> list[list[Lane]]:
    """Return lanes at one angle, in groups that can be flown to and fro.

    The lanes are as many as it takes to cover the area's width with `spacing` each, and spread
    evenly over it; near the border they are moved to where an agent may be. Each is cut where
    obstacles stand. Lanes that lie side by side make one group until an obstacle, or a corner of
    the area, splits them in two or joins two: the cells of the boustrophedon decomposition (Choset,
    Autonomous Robots 9(3), 2000), on lanes in place of a continuous sweep.

    Args:
        area: Area to cover, m.
        free: Where agents may be, m.
        spacing: Greatest distance between lanes, m.
        angle: Direction of the lanes, rad, anticlockwise from the map's x axis.
    """
    level = rotate(area, -angle, origin=(0, 0), use_radians=True)
    room = rotate(free, -angle, origin=(0, 0), use_radians=True).intersection(level)
    west, south, east, north = level.bounds
    if room.is_empty:
        return []
    low, high = room.bounds[1] + MARGIN, room.bounds[3] - MARGIN
    count = max(1, math.ceil((north - south) / spacing - 1e-9))
    width = (north - south) / count
    levels = np.clip(south + width * (np.arange(count) + 0.5), min(low, high), max(low, high))
    groups: list[list[Lane]] = []
    open_groups: list[tuple[float, float, list[Lane]]] = []
    for y in dict.fromkeys(levels.tolist()):
        spans = list(_spans(room, west, east, y))
        grown: list[tuple[float, float, list[Lane]]] = []
        for a, b in spans:
            below = [
                open_group for open_group in open_groups if open_group[0] < b and a < open_group[1]
            ]
            alone = len(below) == 1 and sum(
                below[0][0] < d and c < below[0][1] for c, d in spans
            ) == 1  # fmt: skip
            group = below[0][2] if alone else []
            if not alone:
                groups.append(group)
            group.append(_lane(a, b, y, angle))
            grown.append((a, b, group))
        open_groups = grown
    return groups


def tour(groups: Sequence[Sequence[Lane]], start: Array) -> list[Lane]:
    """Return the lanes of all groups in the order in which to fly them, each in its direction.

    A group is flown to and fro. After it comes the group with the nearest corner, and it is begun
    at that corner.

    Args:
        groups: As `parallel_lanes` returns them.
        start: (2,) where the tour begins, m.
    """
    remaining = [list(group) for group in groups if group]
    position, flown = start, []
    while remaining:
        ways = ((i, way) for i, group in enumerate(remaining) for way in _ways(group))
        best, way = min(ways, key=lambda candidate: math.dist(position, candidate[1][0].start))
        flown += way
        position = way[-1].end
        del remaining[best]
    return flown


def length(lanes: Sequence[Lane]) -> float:
    """Return the length of the lanes and of the straight ways between them, m."""
    between = sum(math.dist(lane.end, following.start) for lane, following in pairwise(lanes))
    return between + sum(lane.length for lane in lanes)


def divide(lanes: Sequence[Lane], shares: int) -> list[list[Lane]]:
    """Return a tour in sections of equal length; a lane may be cut in two.

    No agent flies the way from one section to the next, so the sections that begin with one are a
    little shorter.

    Args:
        lanes: In order.
        shares: Number of sections.
    """
    each = length(lanes) / shares
    sections: list[list[Lane]] = [[]]
    flown = 0.0  # of the section, with the way to its next lane
    for k, whole in enumerate(lanes):
        lane = whole
        if k and sections[-1]:
            flown += math.dist(lanes[k - 1].end, lane.start)
        while flown + lane.length > each + MIN_LANE and len(sections) < shares:
            keep = each - flown
            if keep >= MIN_LANE:
                middle = lane.start + (lane.end - lane.start) * (keep / lane.length)
                sections[-1].append(Lane(lane.start, middle))
                lane = Lane(middle, lane.end)
            sections.append([])
            flown = 0.0
        sections[-1].append(lane)
        flown += lane.length
    return sections + [[] for _ in range(shares - len(sections))]


def assign_sections(sections: Sequence[list[Lane]], position: Array) -> list[list[Lane]]:
    """Return each agent's section, begun at its nearer end; the ways there are least in total.

    Args:
        sections: As many as agents.
        position: (K, 2) positions of the agents, m.
    """
    ways = np.zeros((len(position), len(sections)))
    for j, section in enumerate(sections):
        if section:
            ends = np.array([section[0].start, section[-1].end])
            ways[:, j] = np.hypot(*(position[:, None] - ends).transpose(2, 0, 1)).min(axis=1)
    assigned = linear_sum_assignment(ways)[1].tolist()
    return [
        from_nearer_end(sections[j], agent_position)
        for agent_position, j in zip(position, assigned, strict=True)
    ]


def from_nearer_end(lanes: Sequence[Lane], position: Array) -> list[Lane]:
    """Return lanes, in the opposite order and direction if their end is nearer than their start."""
    if lanes and math.dist(lanes[-1].end, position) < math.dist(lanes[0].start, position):
        return [lane.reversed() for lane in reversed(lanes)]
    return list(lanes)


def angles(area: Polygon) -> list[float]:
    """Return the directions of an area's sides, each once, rad; of the longest side first."""
    ring = shapely.get_coordinates(area.exterior)
    away = np.diff(ring, axis=0)
    direction = np.arctan2(away[:, 1], away[:, 0]) % math.pi
    order = np.argsort(-np.hypot(*away.T), kind="stable")
    return list(dict.fromkeys(np.round(direction[order], 6).tolist()))


def _ways(group: list[Lane]) -> Iterator[list[Lane]]:
    """The four ways to fly a group to and fro."""
    for lanes in (group, group[::-1]):
        for first in (0, 1):
            yield [
                lane if (i + first) % 2 == 0 else lane.reversed() for i, lane in enumerate(lanes)
            ]


def _spans(room: BaseGeometry, west: float, east: float, y: float) -> list[tuple[float, float]]:
    """Where a level line lies in the room, from west to east."""
    line = room.intersection(LineString([(west - 1, y), (east + 1, y)]))
    ends = [(a, b) for a, _, b, _ in (piece.bounds for piece in shapely.get_parts(line))]
    return sorted((a + MARGIN, b - MARGIN) for a, b in ends if b - a >= MIN_LANE)


def _lane(a: float, b: float, y: float, angle: float) -> Lane:
    c, s = math.cos(angle), math.sin(angle)
    rotation = np.array([[c, s], [-s, c]])
    return Lane(np.array([a, y]) @ rotation, np.array([b, y]) @ rotation)
