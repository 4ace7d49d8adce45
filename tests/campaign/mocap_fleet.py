"""Flights by motion capture over ``star fleet``'s protocols, with faults of the system.

Every flight is simulated on a virtual clock (`tests.end_to_end.virtual_air`), so it is the same in
every run: the transport `radio` flies drones of the fleet, and localizer `mocap` receives what the
fleet's NatNet server sends, as the package ``natnet`` and the source of that name read it; only
their processes and sockets are left out. The fault begins when cf1 has flown for a second. The
drones have Lighthouse decks, which the mission's parameters switch off.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import pytest

from star_core import AgentPhase, PoseFixes, Registry, Scene, Tick, fly, hookimpl, load
from star_core.toolkit import Fault, fill_defaults
from star_fleet.command import MOTION_CAPTURE
from star_fleet.conditions import Condition
from star_fleet.natnet import VERSION, NatNetServer
from star_mocap.source import MocapSourceSpec
from star_mocap.sources import natnet
from star_mocap.system import CaptureFrames
from star_sim import OPTIONS, simulator_arguments
from tests.end_to_end.virtual_air import Air
from tests.plugins.transports.star_radio.virtual import virtual

NEAR: Final = 0.15  # m, within which an estimate is of the right drone
ON_FLOOR: Final = 0.05  # m
HIGH: Final = 0.5  # m: a drone above it has taken off
FLOWN: Final = 1.0  # s, after which the fault begins
HEADER: Final = 4  # bytes of a NatNet message before its content

WORLD: Final = "star: 1\nname: hall\nfence: {low: [-3, -3, 0], high: [3, 3, 3]}\n"
MISSION: Final = """\
star: 1
name: flight
world: hall.yaml
swarm:
  cf1: {start: [-1, -0.5, 0], uri: "udp://air:1"}
  cf2: {start: [-1, 0.5, 0], uri: "udp://air:2"}
safety: {position_lost: {after: 0.5, then: land}}
transport:
  use: radio
  guardian: false
  parameters: {lighthouse.enableEst: 0, loco.enableEst: 0}
localizer: {use: mocap, source: {natnet: {host: fleet}}}
planner: straight
avoider: none
mission:
  - takeoff: {height: 0.7}
  - goto: {agents: cf1, by: [1.0, 0, 0]}
  - hold: {for: 1}
  - land: {}
"""
DECKS: Final = {row: frozenset({Condition.LIGHTHOUSE}) for row in range(2)}


@dataclass
class Flown:
    """A flight, and what happened in it.

    Attributes:
        air: Clock, links and drones.
        injected: When the fault began, s of the clock; infinite if it did not.
        summary: Of the flight.
        events: Times, s of the clock, and texts.
        gaps: Ticks in which an agent in the air was not located.
        worst: Greatest error of an estimate in the air, m.
        highest: Greatest true height, m.
    """

    air: Air
    injected: float = math.inf
    summary: Mapping[str, Any] = field(default_factory=dict)
    events: list[tuple[float, str]] = field(default_factory=list)
    gaps: int = 0
    worst: float = 0.0
    highest: float = 0.0

    @hookimpl
    def star_event(self, event: Any) -> None:
        self.events.append((self.air.now, event.text))

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        flying = tick.health.phase == AgentPhase.FLYING
        self.gaps += int(np.count_nonzero(flying & ~tick.estimate.valid))
        error = np.linalg.norm(tick.estimate.position - self.air.drones["position"], axis=1)
        self.worst = max(self.worst, float(error.max(initial=0.0, where=flying)))

    def after(self, *words: str) -> float:
        """Return how long after the fault an event with some words happened first, s."""
        times = (at for at, text in self.events if all(word in text for word in words))
        return min(times, default=math.inf) - self.injected


class Received(CaptureFrames):
    """The frames of a NatNet server, without its socket."""

    def __init__(self, air: Air, scene: Scene, options: Mapping[str, Any]) -> None:
        super().__init__(scene, options)
        self._air, self._ticks = air, natnet.Ticks()
        self._package: Any = import_module("natnet")
        self._names = {row + 1: name for row, name in enumerate(scene.names)}
        self._server = NatNetServer(scene.names, "127.0.0.1", 0)
        air.fleet.capture(self._receive)

    def _receive(self, fixes: PoseFixes, now: float) -> None:
        for at in np.unique(fixes.time):
            message = self._server.frame(fixes, np.equal(fixes.time, at), now)
            content, version = message[HEADER:], self._package.Version(*VERSION)
            packet = self._package.PacketBuffer(content)
            data = self._package.DataFrame.read_from_buffer(packet, version)
            self.add(self._air.now, natnet.frame_of(data, self._names, self._ticks))

    def close(self) -> None:
        self._server.close()


@contextmanager
def motion_capture(air: Air) -> Iterator[None]:
    """Let localizer `mocap` receive the positions that a fleet's NatNet server sends."""

    def connect(plugins: Registry, scene: Scene, system: Mapping[str, Any]) -> Received:
        schema = {"properties": MocapSourceSpec.system_options(plugins)}
        return Received(air, scene, fill_defaults(system, schema))

    with closing(air.fleet), pytest.MonkeyPatch.context() as patch, virtual(air):
        patch.setattr(MocapSourceSpec, "connect", staticmethod(connect))
        yield


def watched(
    air: Air,
    path: Path,
    changes: Sequence[str],
    receives: AbstractContextManager[None],
    act: Callable[[], object],
    *,
    at_once: bool = False,
) -> Flown:
    """Fly a mission over the air; act once, when cf1 has flown for a second, or at once."""
    flight, risen = Flown(air), math.inf

    def watch() -> None:
        nonlocal risen
        height = air.height
        flight.highest = max(flight.highest, float(height.max()))
        if height[0] > HIGH:
            risen = min(risen, air.now)
        if flight.injected == math.inf and (at_once or air.now - risen > FLOWN):
            flight.injected = air.now
            act()

    air.watch = watch
    registry = Registry(flight)
    with receives:
        flight.summary = fly(load(path, registry, changes), registry)
    return flight


def flown(fault: Mapping[str, Any], *, seed: int, at_once: bool = False) -> Flown:
    """Fly with a fault of the system: mode, rows, seconds and values, as of `Fault`."""
    options = fill_defaults({"positioning": MOTION_CAPTURE, "speed": 1.0}, OPTIONS)
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hall.yaml").write_text(WORLD, encoding="utf-8")
        (folder / "flight.yaml").write_text(MISSION, encoding="utf-8")
        changes = [f"seed={seed}", f"transport.cache={folder}/tables"]
        path = folder / "flight.yaml"
        scene = load(path, Registry(), changes).scene
        air = Air(scene, seed=seed, conditions=DECKS, **simulator_arguments(**options))

        def inject() -> None:
            now = air.fleet.time
            until = dict.fromkeys(fault["rows"], now + fault["seconds"])
            values = {"swap": False, **fault.get("values", {})}
            air.fleet.inject([Fault("positioning", fault["mode"], now, until, values)])

        return watched(air, path, changes, motion_capture(air), inject, at_once=at_once)


def reported(flight: Flown, *, good: bool) -> bool:
    """Report on stderr how a flight was that is not as it should be; return whether it is."""
    if not good:
        events = [(round(at - flight.injected, 2), text) for at, text in flight.events]
        outcome = flight.summary["outcome"], flight.summary["reason"]
        figures = f"gaps {flight.gaps}, worst {flight.worst:.3f} m, highest {flight.highest:.2f} m"
        print(outcome, figures, events, file=sys.__stderr__, flush=True)
    return good


def brief_loss(seed: int) -> bool:
    """Whether an agent flies on by odometry while its body is lost for 0.3 s."""
    flight = flown({"mode": "off", "rows": [0], "seconds": 0.3}, seed=seed)
    completed = flight.summary["outcome"] == "completed" and flight.injected < math.inf
    return reported(flight, good=completed and flight.gaps == 0 and flight.worst < NEAR)


def long_loss(seed: int) -> bool:
    """Whether an agent whose body is lost is landed by `position_lost` within 1.1 s."""
    flight = flown({"mode": "off", "rows": [0], "seconds": 60.0}, seed=seed)
    return reported(flight, good=0.9 <= flight.after("cf1", "position_lost") <= 1.1)


def exchange(seed: int) -> bool:
    """Whether exchanged bodies are noticed within 0.5 s, and the flight goes on."""
    fault = {"mode": "wrong", "rows": [0, 1], "seconds": 60.0, "values": {"swap": True}}
    flight = flown(fault, seed=seed)
    completed = flight.summary["outcome"] == "completed" and flight.worst < NEAR
    return reported(flight, good=completed and flight.after("exchanges bodies") <= 0.5)


def unmeasured(seed: int) -> bool:
    """Whether no agent takes off while one of them has no poses."""
    fault = {"mode": "off", "rows": [1], "seconds": 60.0}
    flight = flown(fault, seed=seed, at_once=True)
    failed = flight.summary["outcome"] != "completed"
    return reported(flight, good=failed and flight.highest < ON_FLOOR)


LOSSES: Final[dict[str, Callable[[int], bool]]] = {
    "a body is lost for 0.3 s: flies on by odometry": brief_loss,
    "a body is lost: `position_lost` 1 s later": long_loss,
    "bodies are exchanged: noticed within 0.5 s": exchange,
    "a body is never measured: no take-off": unmeasured,
}
