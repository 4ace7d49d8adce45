"""Which line each agent of a ``follow`` flies. Nothing here imports numpy."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from star_verbs.follow import polyline
from star_verbs.follow.shapes import places, shape
from star_verbs.follow.waypoints import read
from star_verbs.places import fault
from star_verbs.slots import slots

if TYPE_CHECKING:
    from star_core import Scene

Point = tuple[float, float, float]
STEP = 0.1  # m: how finely a line is looked at; a Crazyflie spans 0.12 m with its propellers


@dataclass(frozen=True, slots=True)
class Route:
    """One line for a number of agents, and where on it or beside it each of them flies.

    Attributes:
        point: The line, map frame, m; of a closed one the last point equals the first.
        yaw_deg: Heading at each point, degrees; empty leaves it open.
        line: Line of the file that each point stands on; empty if there is no file.
        length: How far each agent flies, m.
        ahead: How far along the line each agent begins, m.
        beside: How far each agent's line is shifted, m.
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

    On a named path the agents share the line, evenly apart; along a file each flies the line
    shifted to its place among `slots`.

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
    """Return how near two of the agents that fly a named path evenly apart come, m.

    Looked at in 40 steps from one agent's place to the next.

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
    """Say where on a route no agent can be, and why not.

    Told are each run of such points by its first, and each stretch between good points that leads
    through such a place; what several agents would be told alike is told once.

    Args:
        scene: The mission's scene.
        way: The route.
        name: What the mission calls it.
    """
    told: dict[str, None] = {}
    for dx, dy, dz in dict.fromkeys(way.beside):
        line = [(x + dx, y + dy, z + dz) for x, y, z in way.point]
        faults = [fault(scene, point) for point in line]
        for index, message in enumerate(faults):
            if message is None and index + 1 < len(line) and faults[index + 1] is None:
                stretch = polyline.dense(line[index], line[index + 1], STEP)
                why = next(filter(None, (fault(scene, point) for point in stretch)), None)
            else:
                why = None if index and faults[index - 1] else message
            if why is not None:
                where = f"{name}:{way.line[index]}" if way.line else name
                told[f"{where}: {why}"] = None
    return told
