"""How fast drones touch the floor: normal landings, and take-offs that are broken off.

Over the radio transport's own protocol against simulated firmware (`star fleet`) on a virtual
clock, and in the simulator. Printed are quantiles and the number of touchdowns above 0.4 m/s.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from star_core import Operator, Registry, fly, hookimpl, load
from tests.end_to_end.virtual_air import Air, flown

GENTLE: Final = 0.4  # m/s
FLYING: Final = 0.02  # m
MISSION: Final = """\
star: 1
name: short
world: room.yaml
seed: {seed}
rate: 100
transport: sim
localizer: flow
planner: straight
avoider: none
swarm:
  cf1: {{start: [0, 0, 0]}}
  cf2: {{start: [1.5, 0, 0]}}
  cf3: {{start: [-1.5, 0, 0]}}
mission:
{steps}
"""
ROOM: Final = "star: 1\nname: room\nfence: {low: [-3, -3, 0], high: [3, 3, 2]}\n"


def steps(height: float, climb: float, *, twice: bool = False, speed: float | None = None) -> str:
    """Return the steps of a short mission: heights in m, speeds in m/s."""
    land = "{}" if speed is None else f"{{speed: {speed:.2f}}}"
    once = f"  - takeoff: {{height: {height:.2f}, speed: {climb:.2f}}}\n  - hold: {{for: 1}}\n"
    once += f"  - land: {land}\n"
    return once * (1 + twice)


def drawn(seed: int, case: str) -> tuple[str, float]:
    """Return the steps of a flight, and when it is broken off, s after leaving the floor."""
    random = np.random.default_rng(seed)
    height, climb = random.uniform(0.4, 1.2), random.uniform(0.3, 1.0)
    at = random.uniform(0.05, height / climb) if case == "broken off" else np.inf
    speed = random.uniform(0.2, 0.6) if case == "fast" else None
    return steps(height, climb, twice=case == "twice", speed=speed), float(at)


def by_radio(seed: int, case: str, folder: Path) -> Iterator[float]:
    """Yield the speed of the fastest touchdown of each drone, m/s."""
    text, at = drawn(seed, case)
    departures: list[float] = []

    def watch(air: Air, operator: Operator) -> None:
        if (air.height > FLYING).all():
            departures.append(air.fleet.time)
        if departures and air.fleet.time >= departures[0] + at:
            operator.stops = 1

    yield from flown(folder, steps=text, watch=watch, controller="pid").air.impact.tolist()


def in_simulation(seed: int, case: str, folder: Path) -> Iterator[float]:
    """Yield the speed of the fastest touchdown of each drone, m/s."""
    text, at = drawn(seed, case)
    (folder / "room.yaml").write_text(ROOM)
    (folder / "mission.yaml").write_text(MISSION.format(seed=seed, steps=text))
    operator, impact = Operator(), np.zeros(3)
    before: list[Any] = []  # the truth of the last tick
    departures: list[float] = []

    class Watch:
        @hookimpl
        def star_ticked(self, tick: Any) -> None:
            height = tick.truth.position[:, 2]
            if before:
                landed = (before[-1].position[:, 2] > 0) & (height <= 0)
                impact[landed] = np.maximum(impact, -before[-1].velocity[:, 2])[landed]
            before[:] = [tick.truth]
            if (height > FLYING).all():
                departures.append(tick.time)
            if departures and tick.time >= departures[0] + at:
                operator.stops = 1

    registry = Registry(Watch())
    fly(load(folder / "mission.yaml", registry), registry, operator=operator)
    yield from impact.tolist()


WAYS: Final = {"radio": by_radio, "sim": in_simulation}
CASES: Final = ("normal", "fast", "twice", "broken off")


def main() -> None:
    """Fly, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=100, help="of each row")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--ways", nargs="*", choices=WAYS, default=list(WAYS))
    parser.add_argument("--cases", nargs="*", choices=CASES, default=list(CASES))
    parser.add_argument("--verbose", action="store_true", help="print each fast touchdown")
    options = parser.parse_args()
    print("| by | case | flights | touchdowns | median | 99 % | fastest | above 0.4 m/s |")
    print("|---" * 8 + "|")
    for way in options.ways:
        for case in options.cases:
            speeds: list[float] = []
            for seed in range(options.first, options.first + options.flights):
                with (
                    tempfile.TemporaryDirectory() as name,
                    contextlib.redirect_stderr(io.StringIO()),
                ):
                    flight = list(WAYS[way](seed, case, Path(name)))
                if options.verbose and max(flight) > GENTLE:
                    print(seed, np.round(flight, 2), drawn(seed, case), flush=True)
                speeds += [speed for speed in flight if speed > 0]
            figures = [np.median(speeds), np.quantile(speeds, 0.99), max(speeds)]
            numbers = " | ".join(f"{figure:.2f}" for figure in figures)
            fast = sum(speed > GENTLE for speed in speeds)
            print(
                f"| {way} | {case} | {options.flights} | {len(speeds)} | {numbers} | {fast} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
