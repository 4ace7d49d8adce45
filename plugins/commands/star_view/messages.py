"""The messages of a flight to the process that serves its page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from star_core import Agent, Detections, Event, Image, Tick, World

PORT: Final = 8080


class Watched(NamedTuple):
    """The flight that a page shows.

    Attributes:
        mission: Its name.
        world: Where it is.
        agents: The swarm.
        radius: That the avoider keeps free around each agent, m; None if unknown.
        speed: Of the simulation, over real time; None in real time.
        port: To serve on, or the next free one.
    """

    mission: str
    world: World
    agents: tuple[Agent, ...]
    radius: float | None
    speed: float | None
    port: int


class News(NamedTuple):
    """What happened since the last message of a flight.

    Attributes:
        tick: The newest, without odometry and images.
        factor: Mission time over wall time, lately.
        images: The newest of each camera with its time, s, by row.
        detections: All.
        events: All.
    """

    tick: Tick
    factor: float
    images: Mapping[int, tuple[float, Image]]
    detections: tuple[Detections, ...]
    events: tuple[Event, ...]
