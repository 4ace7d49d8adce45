"""Flights over the radio transport's own protocol on a virtual clock, deterministic by their seeds.

The transport's clock and its UDP sockets are replaced: time advances only while the client sleeps,
by simulating the fleet, and packets go through a simulated link with faults. So a flight is several
times faster than real time, and a lost packet is lost in every run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from star_core import Array, Mask, Operator, Registry, Scene, fly, load
from star_fleet.link_faults import Direction, FaultyLinks, LinkFaults
from star_fleet.packet import NULL, Port
from star_radio.profiles import NUMBER as TAKE_OFF_PROFILE
from tests.plugins.transports.star_radio.virtual import EPOCH, VirtualTime, virtual
from tests.simulators import ideal_fleet

TAKEOFF, LAND, START_TRAJECTORY = 7, 8, 13  # commands to the high-level commander
TAKEN_OFF = 0.4  # m
ON_FLOOR = 0.05  # m
STILL_TIME = 0.5  # s, for which drones on the floor are watched
MAX_IMPACT = 1.0  # m/s, at which a landing counts as a fall


class Air(VirtualTime):
    """Simulated drones, the links to them and the clock of their client.

    The drone in row i is at ``udp://air:i+1``; at other addresses there is none.

    Args:
        scene: The drones.
        seed: Of the faults of the links.
        polls: Whether the links are those of a Crazyradio, which sends null packets.
        options: Of the fleet.

    Attributes:
        fleet: The drones; its own UDP ports are not used.
        links: To each of them.
        watch: Called after each cycle of 10 ms.
        impact: (N,) greatest speed at which each drone hit the floor, m/s.
        ordered: When the client first sent each command to a high-level commander, s of the
            fleet's time, by the number of the command; the trajectory of a take-off is one.
    """

    def __init__(self, scene: Scene, *, seed: int = 0, polls: bool = True, **options: Any) -> None:
        super().__init__(polls=polls)
        self.fleet = ideal_fleet(scene, **options)
        self.uris = [f"udp://air:{row + 1}" for row in range(len(scene.agents))]
        self.links = FaultyLinks(len(scene.agents), seed=seed)
        self._null_packets = FaultyLinks(len(scene.agents), seed=seed)
        self._null_packets.faults = self.links.faults
        self.watch: Callable[[], object] = lambda: None
        self.impact = np.zeros(len(scene.agents))
        self.ordered: dict[int, float] = {}
        for row in range(len(scene.agents)):
            self.fleet.listen(row, partial(self._to_client, row))

    @property
    def drones(self) -> Any:
        """The truth about each drone."""
        return self.fleet.simulator.drones

    @property
    def height(self) -> Array:
        """(N,) of each drone above the floor, m."""
        height: Array = self.drones["position"][:, 2].copy()
        return height

    def advance(self) -> None:
        super().advance()
        self.watch()

    def simulate(self) -> float:
        """Let 10 ms pass."""
        before = self.drones["velocity"][:, 2].copy(), self.height
        self.fleet.advance()
        landed = (before[1] > 0) & (self.height <= 0)
        self.impact = np.where(landed, np.maximum(self.impact, -before[0]), self.impact)
        self.links.deliver(self.fleet.time)
        self._null_packets.deliver(self.fleet.time)
        return EPOCH + self.fleet.time

    def carry(self, uri: str, packet: bytes) -> None:
        if uri in self.uris:
            if packet[0] >> 4 == Port.HIGH_LEVEL:
                climbs = packet[1] == START_TRAJECTORY and packet[6] == TAKE_OFF_PROFILE
                self.ordered.setdefault(TAKEOFF if climbs else packet[1], self.fleet.time)
            row = self.uris.index(uri)
            deliver = partial(self._to_vehicle, row, packet)
            self.links.send(row, Direction.TO_VEHICLE, self.fleet.time, deliver)

    def poll(self, uri: str) -> None:
        if uri in self.uris:
            row = self.uris.index(uri)
            deliver = partial(self.fleet.handle, row, NULL)
            self._null_packets.send(row, Direction.TO_VEHICLE, self.fleet.time, deliver)

    def _to_vehicle(self, row: int, packet: bytes) -> None:
        for answer in self.fleet.handle(row, packet):
            self._to_client(row, answer)

    def _to_client(self, row: int, packet: bytes) -> None:
        deliver = partial(self.deliver, self.uris[row], packet)
        self.links.send(row, Direction.TO_CLIENT, self.fleet.time, deliver)


LINK_LOST = "safety={link_lost: {}}"  # a change of a mission
WORLD = """\
star: 1
name: room
fence: {low: [-3, -3, 0], high: [3, 3, 2]}
"""
MISSION = """\
star: 1
name: short
world: room.yaml
rate: 20
transport: {{use: radio, guardian: false, cache: '{cache}'}}
localizer: flow
planner: straight
avoider: none
swarm:
{swarm}
mission:
{steps}
"""
STEPS = """\
  - takeoff: {height: 0.5}
  - hold: {for: 1}
  - land: {}
"""


@dataclass
class Flown:
    """What became of a flight.

    Attributes:
        summary: Of the flight.
        air: After it.
        locked: (N,) whether each drone was locked at the end.
    """

    summary: dict[str, Any]
    air: Air
    locked: Mask = field(init=False)

    def __post_init__(self) -> None:
        self.locked = self.air.drones["locked"] != 0

    @property
    def aloft(self) -> list[int]:
        """Drones that are not on the floor."""
        return [int(row) for row in np.flatnonzero(self.air.height > ON_FLOOR)]

    @property
    def fallen(self) -> list[int]:
        """Drones that were locked, hit the floor at more than 1 m/s, or are not on it."""
        wrong = self.locked | (self.air.impact > MAX_IMPACT) | (self.air.height > ON_FLOOR)
        return [int(row) for row in np.flatnonzero(wrong)]


def flown(
    folder: Path,
    *,
    n: int = 3,
    seed: int = 0,
    faults: Sequence[LinkFaults] = (),
    steps: str = STEPS,
    changes: Sequence[str] = (),
    watch: Callable[[Air, Operator], object] = lambda _air, _operator: None,
    after: float = 4.0,
    **options: Any,
) -> Flown:
    """Fly a short mission.

    Args:
        folder: For the mission's files and the client's cache.
        n: Drones.
        seed: Of the faults.
        faults: Of each link, from when all drones have taken off; their cuts count from then.
        steps: Of the mission.
        changes: To the mission, ``path=value``.
        watch: Called after each cycle of 10 ms.
        after: How long the drones are watched after the flight, s; no longer if all are down.
        options: Of `Air`.
    """
    (folder / "room.yaml").write_text(WORLD)
    swarm = "\n".join(
        f"  cf{row + 1}: {{start: [{row % 5 - 2}, {row // 5 - 1}, 0], uri: 'udp://air:{row + 1}'}}"
        for row in range(n)
    )
    text = MISSION.format(cache=folder / "cache", swarm=swarm, steps=steps)
    (folder / "mission.yaml").write_text(text)
    registry, operator = Registry(), Operator()
    mission = load(folder / "mission.yaml", registry, changes)
    air = Air(mission.scene, seed=seed, **{"noise": False, **options})

    def watched() -> None:
        nonlocal faults
        if faults and (air.height > TAKEN_OFF).all():
            now = air.fleet.time
            for row, each in enumerate(faults):
                cuts = tuple((begin + now, end + now) for begin, end in each.cuts)
                air.links.faults[row] = replace(each, cuts=cuts)
            faults = ()
        watch(air, operator)

    air.watch = watched
    try:
        with virtual(air):
            summary = fly(mission, registry, operator=operator)
            air.until(lambda: not (air.height > 0).any(), after)
            air.sleep(min(after, STILL_TIME))
        return Flown(summary, air)
    finally:
        air.fleet.close()
