"""Routes along waypoints and named paths: their lines, and whether agents can fly them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from star_core import Array
from star_verbs.follow.files import read_waypoints
from star_verbs.positions import Point, offset_label, offsets, points_between, shifted

if TYPE_CHECKING:
    from star_core import Scene

CHORDS: Final = 360  # of a curve: those of a 4 m circle deviate from it by less than 0.1 mm
SEGMENT_STEP: Final = 0.1  # m between checked positions; a Crazyflie spans 0.12 m
GOAL_STEP: Final = 0.05  # m between positions checked for the planner


class Polyline:
    """A line through corners, parameterized by the distance flown on it.

    Points that repeat the previous one are dropped, with their headings. A line whose last point
    equals its first is closed: distances wrap around. On an open one, distances before the start or
    past the end are at the start or the end.

    Args:
        point: (M, 3) corners, at least two that differ, m.
        yaw_deg: (M,) heading at each corner, degrees; interpolated the shorter way around between
            corners. Empty for none.

    Attributes:
        length: From start to end, or one lap if it is closed, m.
    """

    def __init__(self, point: Sequence[Sequence[float]], yaw_deg: Sequence[float] = ()) -> None:
        corner = np.array(point, np.float64)
        fresh = np.ones(len(corner), np.bool_)
        fresh[1:] = (corner[1:] != corner[:-1]).any(axis=1)
        corner = corner[fresh]
        offset = np.diff(corner, axis=0)
        segment = np.sqrt((offset**2).sum(axis=1))
        segment = np.where(segment > 0, segment, np.abs(offset).max(axis=1))  # tiny squares are 0
        self._corner = corner
        self._passed = np.concatenate([[0.0], np.cumsum(segment)])
        self._tangent = offset / segment[:, None]
        self._closed = bool((corner[0] == corner[-1]).all())
        self._yaw = np.unwrap(np.radians(np.array(yaw_deg)[fresh])) if len(yaw_deg) else None
        self.length = float(self._passed[-1])

    def at(self, distance: Array) -> tuple[Array, Array]:
        """Return (K, 3) points, m, and (K, 3) unit vectors along the line, at (K,) distances, m."""
        on = self._on(distance)
        segment = np.searchsorted(self._passed, on, "right") - 1
        segment = np.minimum(segment, len(self._tangent) - 1)
        tangent = self._tangent[segment]
        return self._corner[segment] + tangent * (on - self._passed[segment])[:, None], tangent

    def yaw(self, distance: Array) -> Array | None:
        """Return (K,) headings at (K,) distances, rad; None if the line has none."""
        if self._yaw is None:
            return None
        yaw: Array = np.interp(self._on(distance), self._passed, self._yaw)
        return yaw

    def _on(self, distance: Array) -> Array:
        if self._closed:
            return np.mod(distance, self.length)
        return np.clip(distance, 0.0, self.length)


@dataclass(frozen=True, slots=True)
class Route:
    """One line for a number of agents, and each agent's start and offset on it.

    Attributes:
        name: Its name in the mission.
        point: The line, map frame, m; of a closed one the last point equals the first.
        length: Distance each agent flies, m.
        start: Distance along the line at which each agent begins, m.
        offset: Offset of each agent's line, m.
        yaw_deg: Heading at each point, degrees; empty if unspecified.
        line: Line number of each point in the file; empty if there is no file.
    """

    name: str
    point: tuple[Point, ...]
    length: float
    start: tuple[float, ...]
    offset: tuple[Point, ...]
    yaw_deg: tuple[float, ...] = ()
    line: tuple[int, ...] = ()

    def shifted(self, offset: Point) -> list[Point]:
        """Return the line of an agent."""
        return [shifted(point, offset) for point in self.point]

    def label(self, index: int, offset: Point) -> str:
        """Return the origin of a point in its file, and its offset, for messages."""
        where = f"{self.name}:{self.line[index]}" if self.line else self.name
        return f"{where}{offset_label(offset, len(self.offset))}"


def route(scene: Scene, agents: int, options: dict[str, Any]) -> Route:
    """Return the route of `agents` agents along a file's waypoints or a named path.

    On a named path the agents share the line, evenly spaced; along a file each flies the line
    shifted by one of `star_verbs.positions.offsets`.

    Args:
        scene: The mission's scene.
        agents: Number of agents.
        options: Options of the verb.

    Raises:
        InputError: The file cannot be used.
    """
    if "file" in options:
        file = options["file"]
        waypoints = read_waypoints(scene.file(file), file)
        shifts = tuple(offsets(agents, options["spacing"]))
        flown = length(waypoints.point)
        return Route(
            file, waypoints.point, flown, (0.0,) * agents, shifts, waypoints.yaw_deg, waypoints.line
        )
    name = options["path"]
    point = closed_path(name, options["size"], options["centre"], options.get("width"))
    lap = length(point)
    return Route(
        name,
        point,
        length=lap * options["laps"],
        start=tuple(lap * i / intervals(name, agents) for i in range(agents)),
        offset=((0.0, 0.0, 0.0),) * agents,
    )


def closed_path(
    name: str, size: float, centre: Sequence[float], width: float | None = None
) -> tuple[Point, ...]:
    """Return the points of one lap of a named path around `centre`; the last equals the first.

    A box begins at its corner of least x and y, a circle at its greatest x, both anticlockwise. The
    figure 8 is the lemniscate of Gerono ``x = a sin t``, ``y = a sin t cos t`` with
    ``a = size / 2``, from its crossing.

    Args:
        name: ``box``, ``circle`` or ``figure8``.
        size: Side, diameter or length, m.
        centre: x, y, z of its center, m; the path is level.
        width: Along y, m; the path's own if not given.

    Example:
        >>> closed_path("box", 2.0, (1, 1, 0.8), width=1.0)[:2]
        ((0.0, 0.5, 0.8), (2.0, 0.5, 0.8))
    """
    half = size / 2
    turn = [math.tau * i / CHORDS for i in range(CHORDS)]
    if name == "box":
        corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    elif name == "circle":
        corners = [(half * math.cos(t), half * math.sin(t)) for t in turn]
    else:
        corners = [(half * math.sin(t), half * math.sin(t) * math.cos(t)) for t in turn]
    stretch = 1.0 if width is None else width / (half if name == "figure8" else size)
    x, y, z = (float(value) for value in centre)
    return tuple((x + u, y + stretch * v, z) for u, v in [*corners, corners[0]])


def intervals(name: str, agents: int) -> int:
    """Return the number of equal intervals into which a lap is divided for a number of agents.

    As many as there are agents; on the figure 8 an odd number, so that no two agents, half a lap
    apart, reach its crossing at the same time.

    >>> intervals("circle", 2), intervals("figure8", 2), intervals("figure8", 3)
    (2, 3, 3)
    """
    if name == "figure8" and agents > 1:
        return agents + 1 - agents % 2
    return agents


def length(point: Sequence[Point]) -> float:
    """Return the length of the line through points, in their unit."""
    return math.fsum(math.dist(a, b) for a, b in pairwise(point))


def min_distance(name: str, size: float, agents: int, width: float | None = None) -> float:
    """Return the least distance between two agents that fly a named path evenly spaced, m.

    Evaluated in 40 steps from one agent's position to the next.

    >>> round(min_distance("circle", 2.0, 2), 3)
    2.0
    """
    steps = 40
    count = steps * intervals(name, agents)
    path = Polyline(closed_path(name, size, (0.0, 0.0, 0.0), width))
    ring, _ = path.at(np.arange(count, dtype=np.float64) * (path.length / count))
    apart = (ring - np.roll(ring, -steps * i, axis=0) for i in range(1, agents))
    return min(float(np.linalg.norm(offset, axis=1).min()) for offset in apart)


def route_faults(scene: Scene, flown: Route) -> list[str]:
    """Return which points of a route are not flyable, and why.

    Each run of such points is reported by its first, and so is each segment between good points
    that crosses such a point; equal messages for several agents are reported once.
    """
    messages: dict[str, None] = {}
    for offset in dict.fromkeys(flown.offset):
        points = flown.shifted(offset)
        faults = [scene.position_fault(point) for point in points]
        for index, fault in enumerate(faults):
            if fault is None and index + 1 < len(points) and faults[index + 1] is None:
                segment = points_between(points[index], points[index + 1], SEGMENT_STEP)
                first = next(filter(None, map(scene.position_fault, segment)), None)
            else:
                first = None if index and faults[index - 1] else fault
            if first is not None:
                messages[f"{flown.label(index, offset)}: {first}"] = None
    return list(messages)


def labelled_positions(flown: Route) -> Iterator[tuple[str, Point]]:
    """Yield positions along each agent's line, at most `GOAL_STEP` apart, with their labels."""
    for offset in dict.fromkeys(flown.offset):
        for index, (a, b) in enumerate(pairwise(flown.shifted(offset))):
            label = flown.label(index, offset)
            yield from ((label, point) for point in points_between(a, b, GOAL_STEP))
