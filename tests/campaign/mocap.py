"""Flights by motion capture: accuracy, latencies, markers without names, and what a system loses.

``make mocap`` prints the tables of docs/mocap.md. Flights begin with seed 1000, in simulation, and
those of `mocap_fleet` over the protocols of ``star fleet``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pytest

from star_core import AgentPhase, Flight, Registry, Tick, Transform, fly, hookimpl, load
from star_core.discovery import Source
from star_faults.fault_file import faults_of
from star_faults.injector import FaultInjector
from star_mocap.time_offset import TimeOffset
from tests.campaign import mocap_fleet
from tests.campaign.mocap_fleet import NEAR, ON_FLOOR, WORLD

TABLES = ("accuracy", "latency", "passing", "losses", "fleet")
SEED = 1000
MISSION = Path(__file__).parents[2] / "missions" / "motion_capture.yaml"
LATENCIES = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12)  # s
BEGINS = 3.5  # s, of a fault: in flight
APART = 0.4  # m, at which two drones pass

FLIGHT = """\
star: 1
name: flight
world: hall.yaml
swarm:
  cf1: {{start: [-1, {low}, 0]}}
  cf2: {{start: [{x}, {high}, 0]}}
safety: {{position_lost: {{after: 0.5, then: land}}}}
transport: {{use: sim, positioning: {{rate: 100, std: 0.002, latency: 0.02, jitter: 0.003{more}}}}}
localizer: mocap
planner: straight
avoider: none
mission:
  - takeoff: {{height: 0.8}}
  - goto: {{agents: cf1, by: [2, 0, 0]}}
  - land: {{}}
"""
PASSING = FLIGHT.replace(
    "  - goto: {{agents: cf1, by: [2, 0, 0]}}\n",
    "  - parallel:\n      - goto: {{agents: cf1, by: [2, 0, 0]}}\n"
    "      - goto: {{agents: cf2, by: [-2, 0, 0]}}\n",
)


class Flown(NamedTuple):
    """A flight.

    Attributes:
        seed: Of the flight.
        summary: Of the flight.
        worst: Greatest distance of an estimate from the truth, m, in the air.
        highest: Greatest true height, m.
        gaps: Ticks in which an agent in the air was not located.
        on_board: RMS error in the plane of the on-board estimates, in the frames of the starts, m.
        along_z: RMS error of the estimated heights, m.
    """

    seed: int
    summary: dict[str, Any]
    worst: float
    highest: float
    gaps: int
    on_board: float
    along_z: float

    @property
    def completed(self) -> bool:
        return bool(self.summary["outcome"] == "completed")

    def when(self, *words: str) -> float:
        """Return when an event with some words happened first, s; infinite if it did not."""
        times = (
            event["time"]
            for event in self.summary["events"]
            if all(word in event["text"] for word in words)
        )
        return min(times, default=np.inf)


class Watch:
    """Compares estimates with the truth.

    Attributes:
        worst: As of `Flown`, like the next two.
        highest: As of `Flown`.
        gaps: As of `Flown`.
        planar: Squared errors in the plane of the on-board estimates, m².
        heights: Squared errors of the estimated heights, m².
    """

    def __init__(self) -> None:
        self.worst = self.highest = 0.0
        self.gaps = 0
        self.planar: list[float] = []
        self.heights: list[float] = []
        self._frames = Transform(np.zeros(0), np.zeros((0, 3)))

    @hookimpl
    def star_mission_started(self, flight: Flight) -> None:
        agents = flight.scene.agents
        starts = np.array([agent.start for agent in agents])
        self._frames = Transform(np.array([agent.yaw for agent in agents]), starts)

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        if tick.truth is None:
            return
        height = tick.truth.position[:, 2]
        self.highest = max(self.highest, float(height.max()))
        flying = tick.health.phase == AgentPhase.FLYING
        off = tick.estimate.position - tick.truth.position
        self.heights += (off[flying, 2] ** 2).tolist()
        error = np.linalg.norm(off, axis=1)
        self.worst = max(self.worst, float(error.max(initial=0.0, where=flying)))
        self.gaps += int(np.count_nonzero(flying & ~tick.estimate.valid))
        offset = self._frames.apply(tick.telemetry.position) - tick.truth.position
        self.planar += np.vecdot(offset[:, :2], offset[:, :2])[flying].tolist()


def flown(
    path: Path,
    seed: int,
    assignments: Sequence[str] = (),
    faults: Sequence[Any] = (),
    observers: Sequence[object] = (),
) -> Flown:
    """Fly a mission in simulation with some faults, in the form of a fault file."""
    watch = Watch()
    registry = Registry(watch, *observers)
    mission = load(path, registry, [f"seed={seed}", *assignments])
    if faults:
        injector = FaultInjector(mission.scene, faults_of(list(faults), mission.scene))
        registry.add(injector, Source("tests:faults"))
    summary = fly(mission, registry)
    rms = [float(np.sqrt(np.mean(squares or [0.0]))) for squares in (watch.planar, watch.heights)]
    return Flown(seed, summary, watch.worst, watch.highest, watch.gaps, *rms)


def written(folder: Path, text: str, *, more: str = "", apart: float = 1.0, x: float = -1) -> Path:
    """Write a mission of two drones at a distance along y, m, and return its path."""
    (folder / "hall.yaml").write_text(WORLD, encoding="utf-8")
    path = folder / "flight.yaml"
    path.write_text(text.format(more=more, low=-apart / 2, high=apart / 2, x=x), encoding="utf-8")
    return path


def passing(seed: int) -> bool:
    """Return whether two drones with a marker each keep their identities when they pass."""
    with TemporaryDirectory() as folder:
        more = ", markers: true, dropout_rate: 0.2, dropout_time: 0.1"
        flight = flown(written(Path(folder), PASSING, more=more, apart=APART, x=1.0), seed)
    return flight.completed and flight.worst < NEAR


def latency_error(seed: int, latency: float) -> float:
    """Return the error of the estimated latency at the end of a flight, s."""
    offsets: list[TimeOffset] = []

    def offset(agents: int) -> TimeOffset:
        offsets.append(TimeOffset(agents))
        return offsets[-1]

    changes = {"timestamps": "false", "latency": latency, "jitter": 0}
    with pytest.MonkeyPatch.context() as patch:  # the only way to its estimate
        patch.setattr("star_mocap.localizer.TimeOffset", offset)
        flown(MISSION, seed, [f"transport.positioning.{k}={v}" for k, v in changes.items()])
    return float(offsets[-1].latency.seconds) - latency


def faulty(seed: int, mode: str, **values: Any) -> Flown:
    """Return a flight with a fault of the positioning system."""
    with TemporaryDirectory() as folder:
        fault = {"component": "positioning", "mode": mode, **values}
        return flown(written(Path(folder), FLIGHT), seed, (), [fault])


def brief_loss(seed: int) -> bool:
    """Whether an agent flies on by odometry while its body is lost for 0.3 s."""
    flight = faulty(seed, "off", agents="cf1", **{"at": BEGINS, "for": 0.3})
    return flight.completed and flight.gaps == 0 and flight.worst < NEAR


def long_loss(seed: int) -> bool:
    """Whether an agent whose body is lost is landed by `position_lost` within 1.1 s."""
    flight = faulty(seed, "off", agents="cf1", **{"at": BEGINS, "for": 60.0})
    reacted = flight.when("cf1", "position_lost") - BEGINS
    return 0.9 <= reacted <= 1.1 and flight.summary["collisions"]["agent_agent"] == 0


def exchange(seed: int) -> bool:
    """Whether exchanged bodies are noticed within 0.5 s, and the flight goes on."""
    flight = faulty(seed, "wrong", swap=True, at=BEGINS)
    noticed = flight.when("exchanges bodies") - BEGINS
    return noticed <= 0.5 and flight.completed and flight.worst < NEAR


def unmeasured(seed: int) -> bool:
    """Whether no agent takes off while one of them has no poses."""
    flight = faulty(seed, "off", agents="cf2")
    return not flight.completed and flight.highest < ON_FLOOR


class Accuracy(NamedTuple):
    """Of a flight: RMS and worst error, m, NEES, RMS error on board, and of the heights, m."""

    rms: float
    worst: float
    nees: float
    on_board: float
    along_z: float


def accuracy(seed: int, assignments: Sequence[str] = (), mission: Path = MISSION) -> Accuracy:
    """Fly the mission and return its figures."""
    flight = flown(mission, seed, assignments)
    summary = flight.summary
    assert summary["outcome"] == "completed", summary["reason"]
    rms, worst, nees = (float(summary[f"position_{key}"]) for key in ("rmse_m", "worst_m", "nees"))
    return Accuracy(rms, worst, nees, flight.on_board, flight.along_z)


LOSSES: dict[str, Callable[[int], bool]] = {
    "a body is lost for 0.3 s: flies on by odometry": brief_loss,
    "a body is lost: `position_lost` 1 s later": long_loss,
    "bodies are exchanged: noticed within 0.5 s": exchange,
    "a body is never measured: no take-off": unmeasured,
}


def counted(title: str, results: Iterable[bool], flights: int) -> None:
    """Print how many of some flights are as they should be."""
    good = sum(results)
    print(f"| {title} | {good} of {flights} |", flush=True)


def main() -> None:
    """Print the tables of docs/mocap.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=30, help="of each kind; %(default)s")
    parser.add_argument("--passing", type=int, default=300, help="flights; %(default)s")
    parser.add_argument("--only", choices=TABLES, nargs="+")
    parser.add_argument("--processes", type=int, default=1, help="%(default)s")
    options = parser.parse_args()
    only = options.only or TABLES
    seeds = range(SEED, SEED + options.flights)
    with ProcessPoolExecutor(options.processes, initializer=_silent) as pool:
        if "accuracy" in only:
            _accuracy(pool, seeds)
        if "latency" in only:
            _latencies(pool, seeds)
        if "passing" in only:
            many = range(SEED, SEED + options.passing)
            counted(
                "two drones with a marker each pass at 0.4 m", pool.map(passing, many), len(many)
            )
        if "losses" in only:
            for title, holds in LOSSES.items():
                counted(f"{title}, in simulation", pool.map(holds, seeds), len(seeds))
        if "fleet" in only:
            for title, holds in mocap_fleet.LOSSES.items():
                counted(f"{title}, over `star fleet`", pool.map(holds, seeds), len(seeds))


def _accuracy(pool: ProcessPoolExecutor, seeds: Sequence[int]) -> None:
    print("| forwarded | RMS (worst flight), mm | worst, mm | NEES (flights) | RMS on board, mm |")
    print("|---|---|---|---|---|")
    for forward in ("none", "extpos", "extpose"):
        fly_one = partial(accuracy, assignments=(f"localizer.forward={forward}",))
        flights = np.array(list(pool.map(fly_one, seeds)))
        rms = np.sqrt(np.mean(flights[:, 0] ** 2))
        print(
            f"| `{forward}` | {1e3 * rms:.1f} ({1e3 * flights[:, 0].max():.1f}) "
            f"| {1e3 * flights[:, 1].max():.1f} | {flights[:, 2].mean():.2f} "
            f"({flights[:, 2].min():.2f}-{flights[:, 2].max():.2f}) "
            f"| {1e3 * np.sqrt(np.mean(flights[:, 3] ** 2)):.0f} |",
            flush=True,
        )


def _latencies(pool: ProcessPoolExecutor, seeds: Sequence[int]) -> None:
    print("| injected, ms | error, RMS, ms | worst, ms |\n|---|---|---|")
    for latency in LATENCIES:
        errors = 1e3 * np.array(list(pool.map(partial(latency_error, latency=latency), seeds)))
        rms = np.sqrt(np.mean(errors**2))
        print(f"| {1e3 * latency:.0f} | {rms:.1f} | {np.abs(errors).max():.1f} |", flush=True)


def _silent() -> None:
    """Drop what flights report on stderr."""
    sys.stderr = StringIO()


if __name__ == "__main__":
    main()
