"""Flights by motion capture over ``star fleet``, in real time, with faults of the system.

The fleet and its NatNet server are in a process of their own. It injects the fault when cf1 has
flown for a second, and sends when that was and where the drones really were, by the clock that all
processes of a computer share. The drones have Lighthouse decks, which their parameters switch off.
A flight in which a process waited for a processor for longer than `STALL` is not in real time: it
is flown again.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple

import numpy as np

from star_core import AgentPhase, Array, Registry, Tick, fly, hookimpl, load
from star_core.toolkit import Fault, fill_defaults
from star_fleet.command import MOTION_CAPTURE
from star_fleet.conditions import Condition
from star_fleet.natnet import NatNetServer
from star_fleet.server import Fleet
from star_sim import OPTIONS, simulator_arguments

HIGH: Final = 0.5  # m: a drone above it has taken off
FLOWN: Final = 1.0  # s, after which the fault begins
NEAR: Final = 0.15  # m, within which an estimate is of the right drone
ON_FLOOR: Final = 0.05  # m
STALL: Final = 0.1  # s
AGAIN: Final = 20  # times that a flight is flown again at most
START: Final = 30.0  # s, within which the fleet starts

MISSION: Final = """\
star: 1
name: flight
world: hall.yaml
swarm:
  cf1: {start: [-1, -0.5, 0]}
  cf2: {start: [-1, 0.5, 0]}
safety: {position_lost: {after: 0.5, then: land}}
transport: {use: radio, parameters: {lighthouse.enableEst: 0, loco.enableEst: 0}}
localizer: {use: mocap, source: {natnet: {host: 127.0.0.1, multicast: false}}}
planner: straight
avoider: none
mission:
  - takeoff: {height: 0.7}
  - goto: {agents: cf1, by: [1.0, 0, 0]}
  - hold: {for: 1}
  - land: {}
"""
DECKS: Final = {row: frozenset({Condition.LIGHTHOUSE}) for row in range(2)}


class Flown(NamedTuple):
    """A flight.

    Attributes:
        summary: Of the flight.
        injected: When the fault began, s of the computer's clock; infinite if it did not.
        events: Times of the events, s of the computer's clock, and their texts.
        gaps: Ticks in which an agent in the air was not located.
        worst: Greatest distance between estimates and the truth at the time, m, in the air.
        highest: Greatest true height, m.
        stall: Longest time for which a process waited for a processor, s.
    """

    summary: Mapping[str, Any]
    injected: float
    events: list[tuple[float, str]]
    gaps: int
    worst: float
    highest: float
    stall: float

    def after(self, *words: str) -> float:
        """Return how long after the fault an event with some words happened first, s."""
        times = (at for at, text in self.events if all(word in text for word in words))
        return min(times, default=math.inf) - self.injected


@dataclass
class Watch:
    """Notes when events happen, and what is estimated."""

    events: list[tuple[float, str]] = field(default_factory=list)
    estimates: list[tuple[float, Array, Array]] = field(default_factory=list)
    gaps: int = 0

    @hookimpl
    def star_event(self, event: Any) -> None:
        self.events.append((time.monotonic(), event.text))

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        flying = tick.health.phase == AgentPhase.FLYING
        self.gaps += int(np.count_nonzero(flying & ~tick.estimate.valid))
        self.estimates.append((time.monotonic(), tick.estimate.position, flying))

    def worst(self, samples: list[tuple[float, Array]]) -> float:
        """Return the greatest error of an estimate against (time, positions) of the truth, m."""
        times = np.array([at for at, _ in samples])
        worst = 0.0
        for at, position, flying in self.estimates:
            truth = samples[min(int(np.searchsorted(times, at)), len(samples) - 1)][1]
            error = np.linalg.norm(position - truth, axis=1)
            worst = max(worst, float(error.max(initial=0.0, where=flying)))
        return worst


def flown(fault: Mapping[str, Any], *, seed: int = 0, at_once: bool = False) -> Flown:
    """Fly with a fault of the system, until that is in real time."""
    for _time in range(AGAIN):
        flight = once(fault, seed=seed, at_once=at_once)
        if flight.stall <= STALL:
            return flight
        print(f"flown again: waited for {flight.stall:.2f} s", file=sys.__stderr__, flush=True)
    raise TimeoutError("the computer is too busy for flights in real time")


def once(fault: Mapping[str, Any], *, seed: int = 0, at_once: bool = False) -> Flown:
    """Fly with a fault of the system: `Fault`'s mode, agents by row, duration and values."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hall.yaml").write_text(
            "star: 1\nname: hall\nfence: {low: [-3, -3, 0], high: [3, 3, 3]}\n", encoding="utf-8"
        )
        path = folder / "flight.yaml"
        path.write_text(MISSION, encoding="utf-8")
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs, seed, dict(fault), at_once))
        process.start()
        theirs.close()
        try:
            if not ours.poll(START):
                raise TimeoutError("the fleet does not start")
            addresses, port = ours.recv()
            changes = [f"swarm.cf{i}.uri={uri}" for i, uri in enumerate(addresses, 1)]
            changes += [
                f"transport.cache={folder}",
                f"localizer.source.natnet.command_port={port}",
                f"seed={seed}",
            ]
            watch = Watch()
            registry = Registry(watch)
            summary = fly(load(path, registry, changes), registry)
            ours.send(None)
            injected, slipped, samples = ours.recv()
        finally:
            process.terminate()
            process.join()
    highest = max(float(position[:, 2].max()) for _, position in samples)
    worst = watch.worst(samples)
    times = [at for at, _ in samples]
    stall = max(slipped, summary["latest_tick_s"], float(np.diff(times).max()))
    return Flown(summary, injected, watch.events, watch.gaps, worst, highest, stall)


def serve(connection: Connection, seed: int, fault: Mapping[str, Any], at_once: bool) -> None:  # noqa: FBT001 -- of a process
    """Serve the drones until the other end sends something, and send what happened."""
    with TemporaryDirectory() as name:
        (Path(name) / "hall.yaml").write_text(
            "star: 1\nname: hall\nfence: {low: [-3, -3, 0], high: [3, 3, 3]}\n", encoding="utf-8"
        )
        path = Path(name) / "flight.yaml"
        path.write_text(MISSION.replace("use: radio, ", "use: sim} #"), encoding="utf-8")
        changes = ["localizer=flow", f"seed={seed}"]
        scene = load(path, Registry(), changes).scene
    options = fill_defaults({"positioning": MOTION_CAPTURE, "speed": 1.0}, OPTIONS)
    fleet = Fleet(scene, port=0, conditions=DECKS, **simulator_arguments(**options))
    server = NatNetServer(scene.names, "127.0.0.1", 0)
    fleet.capture(server.serve)
    samples: list[tuple[float, Array]] = []
    injected, risen = math.inf, math.inf
    with closing(server), fleet:
        connection.send((fleet.addresses, server.port))
        while not connection.poll(0.01):
            now, drones = time.monotonic(), fleet.simulator.drones
            samples.append((now, drones["position"].copy()))
            if drones["position"][0, 2] > HIGH:
                risen = min(risen, now)
            if injected == math.inf and (at_once or now - risen > FLOWN):
                end = fleet.time + fault["seconds"]
                until = dict.fromkeys(fault["rows"], end)
                values = {"swap": False, **fault.get("values", {})}
                fleet.inject([Fault("positioning", fault["mode"], fleet.time, until, values)])
                injected = now
        connection.send((injected, fleet.slipped, samples))


def reported(flight: Flown, *, good: bool) -> bool:
    """Report on stderr how a flight was that is not as it should be; return whether it is."""
    if not good:
        events = [
            (round(at - flight.injected, 2), text)
            for at, text in flight.events
            if any(word in text for word in ("motion capture", "lost", "late", "brakes", "slow"))
        ]
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
    """Whether an agent whose body is lost is landed by `position_lost` within 1.2 s."""
    flight = flown({"mode": "off", "rows": [0], "seconds": 60.0}, seed=seed)
    return reported(flight, good=0.9 <= flight.after("cf1", "position_lost") <= 1.2)


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
