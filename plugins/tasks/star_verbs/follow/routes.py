"""The line that each agent of a ``follow`` flies. Does not import numpy."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from star_verbs.follow import polyline
from star_verbs.follow.shapes import places, shape
from star_verbs.follow.waypoints import read
from star_verbs.places import fault
from star_verbs.slots import shifted_by, slots

if TYPE_CHECKING:
    from star_core import Scene

Point = tuple[float, float, float]
STEP = 0.1  # m between checked points; a Crazyflie spans 0.12 m with its propellers
FINE = 0.05  # m between points checked for the planner


@dataclass(frozen=True, slots=True)
class Route:
    """One line for a number of agents, and each agent's start and offset on it.

    Attributes:
        point: The line, map frame, m; of a closed one the last point equals the first.
        yaw_deg: Heading at each point, degrees; empty if unspecified.
        line: Line number of each point in the file; empty if there is no file.
        length: Distance each agent flies, m.
        ahead: Distance along the line at which each agent begins, m.
        beside: Offset of each agent's line, m.
    """

    point: tuple[Point, ...]
    yaw_deg: tuple[float, ...]
    line: tuple[int, ...]
    length: float
    ahead: tuple[float, ...]
    beside: tuple[Point, ...]


def route(  # noqa: PLR0913 -- a mission's own options
    scene: Scene,
    agents: int,
    *,
    file: str | None = None,
    path: str | None = None,
    size: float = 0.0,
    width: float | None = None,
    centre: Sequence[float] = (),
    laps: int = 1,
    spacing: float = 0.6,
) -> Route:
    """Return the route of `agents` agents along a file's points or a named path.

    On a named path the agents share the line, evenly spaced; along a file each flies the line
    shifted to its position among `slots`.

    Raises:
        InputError: The file cannot be used.
    """
    if file is not None:
        found = read(scene.file(file), file)
        return Route(
            point=found.point,
            yaw_deg=found.yaw_deg,
            line=found.line,
            length=polyline.length(found.point),
            ahead=(0.0,) * agents,
            beside=tuple(slots(agents, (0.0, 0.0, 0.0), spacing)),
        )
    name = str(path)
    point = shape(name, size, centre, width)
    lap = polyline.length(point)
    return Route(
        point=point,
        yaw_deg=(),
        line=(),
        length=lap * laps,
        ahead=tuple(lap * i / places(name, agents) for i in range(agents)),
        beside=((0.0, 0.0, 0.0),) * agents,
    )


def least_distance(name: str, size: float, agents: int, width: float | None = None) -> float:
    """Return the least distance between two agents that fly a named path evenly spaced, m.

    Evaluated in 40 steps from one agent's position to the next.

    >>> round(least_distance("circle", 2.0, 2), 3)
    2.0
    """
    steps, parts = 40, places(name, agents)
    ring = polyline.evenly(shape(name, size, (0.0, 0.0, 0.0), width), steps * parts)
    return min(
        math.dist(here, ring[(i + steps * apart) % len(ring)])
        for apart in range(1, agents)
        for i, here in enumerate(ring)
    )


def way_faults(scene: Scene, way: Route, name: str) -> Iterable[str]:
    """Report points of a route that are not flyable, and why.

    Each run of such points is reported by its first, and so is each segment between good points
    that crosses such a point; equal messages for several agents are reported once.

    Args:
        scene: The mission's scene.
        way: The route.
        name: Its name in the mission.
    """
    messages: dict[str, None] = {}
    for shift in dict.fromkeys(way.beside):
        line = _shifted(way, shift)
        faults = [fault(scene, point) for point in line]
        for index, message in enumerate(faults):
            if message is None and index + 1 < len(line) and faults[index + 1] is None:
                stretch = polyline.dense(line[index], line[index + 1], STEP)
                why = next(filter(None, (fault(scene, point) for point in stretch)), None)
            else:
                why = None if index and faults[index - 1] else message
            if why is not None:
                messages[f"{_label(way, name, index, shift)}: {why}"] = None
    return messages


def positions(way: Route, name: str) -> Iterator[tuple[str, Point]]:
    """Yield positions along each agent's line, at most `FINE` apart, each with its label.

    Args:
        way: The route.
        name: Its name in the mission.
    """
    for shift in dict.fromkeys(way.beside):
        for index, (a, b) in enumerate(pairwise(_shifted(way, shift))):
            label = _label(way, name, index, shift)
            yield from ((label, point) for point in polyline.dense(a, b, FINE))


def _shifted(way: Route, shift: Point) -> list[Point]:
    dx, dy, dz = shift
    return [(x + dx, y + dy, z + dz) for x, y, z in way.point]


def _label(way: Route, name: str, index: int, shift: Point) -> str:
    """Return the origin of a route's point in its file, and its offset, for messages."""
    where = f"{name}:{way.line[index]}" if way.line else name
    return f"{where}{shifted_by(shift, len(way.beside))}"
