"""Flights over the radio transport's own protocol on a virtual clock, deterministic by their seeds.

The transport's clock and its UDP sockets are replaced: time advances only while the client sleeps,
by simulating the fleet, and packets go through a simulated link with faults. So a flight is several
times faster than real time, and a lost packet is lost in every run.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
import pytest

from star_core import Array, Mask, Registry, Scene, fly, load
from star_core.operator_stop import OperatorStop
from star_fleet.link_faults import Direction, FaultyLinks, LinkFaults
from star_fleet.server import Fleet
from star_radio.link_protocol import LinkListener

T = TypeVar("T")
R = TypeVar("R")

EPOCH = 1000.0  # s, of the virtual clock when the fleet starts
IDLE_PERIOD = 0.1  # s, between two calls of `LinkListener.idle`
TAKEN_OFF = 0.4  # m
ON_FLOOR = 0.05  # m
MAX_IMPACT = 1.0  # m/s, at which a landing counts as a fall


class Air:
    """Simulated drones, the links to them and the clock of their client.

    Args:
        scene: The drones.
        seed: Of the faults of the links.
        options: Of the fleet.

    Attributes:
        fleet: The drones; its own UDP ports are not used.
        links: To each of them.
        watch: Called after each cycle of 10 ms.
        impact: (N,) greatest speed at which each drone hit the floor, m/s.
    """

    def __init__(self, scene: Scene, *, seed: int = 0, **options: Any) -> None:
        self.fleet = Fleet(scene, port=0, **options)
        self.links = FaultyLinks(len(scene.agents), seed=seed)
        self.watch: Callable[[], object] = lambda: None
        self.impact = np.zeros(len(scene.agents))
        self._ears: dict[int, LinkListener] = {}
        self._idle = 0.0
        self._lock = threading.RLock()
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

    def monotonic(self) -> float:
        """The virtual clock, s."""
        return EPOCH + self.fleet.time

    def sleep(self, seconds: float) -> None:
        """Let virtual time pass."""
        with self._lock:
            until = self.fleet.time + seconds
            while self.fleet.time < until - 1e-6:
                self.advance()

    def advance(self) -> None:
        """Let 10 ms pass."""
        before = self.drones["velocity"][:, 2].copy(), self.height
        self.fleet.advance()
        landed = (before[1] > 0) & (self.height <= 0)
        self.impact = np.where(landed, np.maximum(self.impact, -before[0]), self.impact)
        self.links.deliver(self.fleet.time)
        if self.fleet.time - self._idle >= IDLE_PERIOD:
            self._idle = self.fleet.time
            for ear in list(self._ears.values()):
                ear.idle(self.monotonic())
        self.watch()

    def open(self, uri: str, ear: LinkListener) -> LinkDriver:
        """Connect a client to the drone at ``udp://air:number``; in place of `UdpLinks.open`."""
        row = int(uri.rpartition(":")[2]) - 1
        self._ears[row] = ear
        return LinkDriver(self, row)

    def close(self) -> None:
        """In place of `UdpLinks.close`."""

    def hang_up(self, row: int) -> None:
        """End the link to a drone."""
        self._ears.pop(row, None)

    def send(self, row: int, packet: bytes) -> None:
        """Carry a packet to a drone, and its answers back."""
        with self._lock:
            deliver = partial(self._to_vehicle, row, packet)
            self.links.send(row, Direction.TO_VEHICLE, self.fleet.time, deliver)

    def _to_vehicle(self, row: int, packet: bytes) -> None:
        for answer in self.fleet.handle(row, packet):
            self._to_client(row, answer)

    def _to_client(self, row: int, packet: bytes) -> None:
        deliver = partial(self._hear, row, packet)
        self.links.send(row, Direction.TO_CLIENT, self.fleet.time, deliver)

    def _hear(self, row: int, packet: bytes) -> None:
        if (ear := self._ears.get(row)) is not None:
            ear.hear(packet, self.monotonic())


class LinkDriver:
    """The client's end of a link."""

    def __init__(self, air: Air, row: int) -> None:
        self._air, self._row = air, row

    def send(self, packet: bytes) -> None:
        self._air.send(self._row, packet)

    steer = send

    def close(self) -> None:
        self._air.hang_up(self._row)


class _OneByOne:
    """In place of a pool of threads, so that a flight is the same in every run."""

    def __init__(self, _workers: int) -> None:
        pass

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_raised: object) -> None:
        pass

    def map(self, act: Callable[[T], R], each: Iterable[T]) -> Iterator[R]:
        return map(act, each)


@contextmanager
def virtual(air: Air) -> Iterator[None]:
    """Let the radio transport use the virtual clock and the virtual links."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "monotonic", air.monotonic)
        patch.setattr(time, "sleep", air.sleep)
        patch.setattr("star_radio.udp_links.UdpLinks", lambda: air)
        patch.setattr("star_radio.parallel.ThreadPoolExecutor", _OneByOne)
        yield


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
transport: {{use: radio, cache: '{cache}'}}
localizer: flow
planner: straight
avoider: none
swarm:
{swarm}
mission:
{steps}
{rules}
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
    rules: str = "",
    watch: Callable[[Air, OperatorStop], object] = lambda _air, _interrupts: None,
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
        rules: Of the mission.
        watch: Called after each cycle of 10 ms.
        after: How long the drones are watched after the flight, s.
        options: Of the fleet.
    """
    (folder / "room.yaml").write_text(WORLD)
    swarm = "\n".join(
        f"  cf{row + 1}: {{start: [{row % 5 - 2}, {row // 5 - 1}, 0], uri: 'udp://air:{row + 1}'}}"
        for row in range(n)
    )
    text = MISSION.format(cache=folder / "cache", swarm=swarm, steps=steps, rules=rules)
    (folder / "mission.yaml").write_text(text)
    registry, interrupts = Registry(), OperatorStop()
    mission = load(folder / "mission.yaml", registry)
    air = Air(mission.scene, seed=seed, **{"noise": False, **options})

    def watched() -> None:
        nonlocal faults
        if faults and (air.height > TAKEN_OFF).all():
            now = air.fleet.time
            for row, each in enumerate(faults):
                cuts = tuple((begin + now, end + now) for begin, end in each.cuts)
                air.links.faults[row] = replace(each, cuts=cuts)
            faults = ()
        watch(air, interrupts)

    air.watch = watched
    try:
        with virtual(air):
            summary = fly(mission, registry, interrupts=interrupts)
            air.sleep(after)
        return Flown(summary, air)
    finally:
        air.fleet.close()
