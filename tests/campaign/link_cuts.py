"""Flights whose links are cut: which drones fall, and which are in the air 20 s after the end.

Every flight is simulated over the protocol on a virtual clock (`virtual_air`), so that it is the
same in every run. `make link-cuts` prints the table of docs/reliability.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import numpy as np

from star_core import Operator
from star_fleet.link_faults import LinkFaults
from tests.end_to_end.virtual_air import (
    LAND,
    MAX_IMPACT,
    START_TRAJECTORY,
    TAKEOFF,
    Air,
    Flown,
    flown,
)

N = 3
CUT_ROW = 1  # of the drone whose link is cut, if it is one
LENGTHS = (0.3, 0.9, 1.3, 1.5, 1.7, 3.0, 4.5, 7.0)  # s
FIRMWARE_WATCHDOG = 1.9  # s: a longer cut of a drone that setpoints fly makes it fall
AFTER = 20.0  # s after the end of the program, for which the drones are watched
BAD_LINK = LinkFaults(loss=0.2, delay=0.02, jitter=0.1)

CLIMB_TIME = 2.5  # s, after which setpoints fly the drones

HOVER = """\
  - takeoff: {height: 0.5}
  - hold: {for: 3}
  - land: {}
"""
FOLLOW = """\
  - takeoff: {height: 0.5}
  - follow: {file: path.csv, format: poly7, on_board: true}
  - land: {}
"""
# Duration, s, and x, y, z and yaw by powers of the time: 0.4 m ahead in 4 s, from rest to rest.
HEADER = "duration," + ",".join(f"{axis}^{i}" for axis in ("x", "y", "z", "yaw") for i in range(8))
PATH = HEADER + "\n4.0,0,0,0,0,0.0546875,-0.0328125,0.0068359375,-0.00048828125" + ",0" * 24 + "\n"


@dataclass(frozen=True)
class Phase:
    """When a cut begins: between two times after a command is sent first, s."""

    command: int
    begins: tuple[float, float]
    steps: str = HOVER


PHASES = {
    "take-off": Phase(TAKEOFF, (0.1, 1.3)),
    "flight by setpoints": Phase(TAKEOFF, (CLIMB_TIME + 0.5, CLIMB_TIME + 2.0)),
    "landing": Phase(LAND, (0.0, 2.0)),
    "on-board `follow`": Phase(START_TRAJECTORY, (0.2, 3.0), FOLLOW),
}


class Cut:
    """Cuts the links of drones once.

    Args:
        phase: Of the flight.
        length: Of the cut, s.
        rows: Of the drones.
        seed: Of the time at which the cut begins.
    """

    def __init__(self, phase: Phase, length: float, rows: Sequence[int], seed: int) -> None:
        self._phase, self._length, self._rows = phase, length, rows
        self._delay = float(np.random.default_rng([seed, 7]).uniform(*phase.begins))
        self.done = False

    def __call__(self, air: Air, operator: Operator) -> None:
        now = air.fleet.time
        if self.done or now < air.ordered.get(self._phase.command, np.inf) + self._delay:
            return
        self.done = True
        for row in self._rows:
            air.links.faults[row] = LinkFaults(cuts=((now, now + self._length),))


@dataclass(frozen=True)
class Outcome:
    """What became of a flight.

    Attributes:
        fell: Drones that hit the floor at more than `MAX_IMPACT`, or were locked.
        aloft: Drones that are in the air `AFTER` the end of the program.
        reason: Why the flight ended.
        completed: Whether the program reported the mission as completed.
    """

    fell: tuple[int, ...]
    aloft: tuple[int, ...]
    reason: str
    completed: bool

    @classmethod
    def of(cls, flight: Flown) -> Outcome:
        fell = np.flatnonzero((flight.air.impact > MAX_IMPACT) | flight.locked)
        summary = flight.summary
        completed = summary["outcome"] == "completed"
        return cls(tuple(fell.tolist()), tuple(flight.aloft), summary["reason"], completed)


def cut_flight(phase: str, length: float, *, whole: bool, seed: int) -> Outcome:
    """Fly with one cut of one link or of the `whole` swarm's."""
    cut = Cut(PHASES[phase], length, range(N) if whole else [CUT_ROW], seed)
    with TemporaryDirectory() as folder:
        (Path(folder) / "path.csv").write_text(PATH)
        steps = PHASES[phase].steps
        flight = flown(Path(folder), n=N, seed=seed, steps=steps, watch=cut, after=AFTER)
    assert cut.done
    return Outcome.of(flight)


def spoil_links(air: Air, _operator: Operator) -> None:
    """Let the links lose and delay packets from the take-off on."""
    if TAKEOFF in air.ordered and air.links.faults[0] != BAD_LINK:
        air.links.faults[:] = [BAD_LINK] * len(air.links.faults)


def bad_link_flight(seed: int) -> Outcome:
    """Fly over links that lose and delay packets."""
    with TemporaryDirectory() as folder:
        return Outcome.of(flown(Path(folder), n=N, seed=seed, watch=spoil_links, after=AFTER))


def excused(phase: str, length: float) -> bool:
    """Whether the firmware's own watchdog makes a drone fall after such a cut."""
    return phase == "flight by setpoints" and length >= FIRMWARE_WATCHDOG


Cell: TypeAlias = tuple[str, float, bool]
"""Phase, length of the cut, s, and whether all links are cut."""

CELLS: tuple[Cell, ...] = tuple(product(PHASES, LENGTHS, (False, True)))


def campaign(
    fly: Callable[[int], Outcome], flights: int, pool: ProcessPoolExecutor
) -> list[Outcome]:
    """Fly with the seeds 0, 1, ...."""
    return list(pool.map(fly, range(flights), chunksize=5))


def counted(outcomes: Sequence[Outcome]) -> tuple[int, int]:
    """Return in how many flights a drone fell, and in how many one stayed in the air."""
    return sum(bool(outcome.fell) for outcome in outcomes), sum(
        bool(outcome.aloft) for outcome in outcomes
    )


def main() -> int:
    """Print the table; return 1 if a drone fell or stayed in the air that need not.

    Each cell is written to stderr as soon as it has been flown.
    """
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0], allow_abbrev=False)
    parser.add_argument("--flights", type=int, default=100, help="per cell: %(default)s")
    parser.add_argument("--processes", type=int, default=1, help="%(default)s")
    parser.add_argument("--lengths", type=float, nargs="+", default=LENGTHS, help="of the cuts, s")
    parser.add_argument("--phases", nargs="+", default=list(PHASES), choices=list(PHASES))
    parser.add_argument("--verbose", action="store_true", help="print each flight that failed")
    options = parser.parse_args()
    bad = False
    header = " | ".join(f"{length:g} s" for length in options.lengths)
    lines = [f"| links cut in | {header} |", "|---|" + "---|" * len(options.lengths)]

    def result(name: str, outcomes: Sequence[Outcome], *, may_fall: bool = False) -> str:
        nonlocal bad
        fell, aloft = counted(outcomes)
        bad |= bool(aloft or (fell and not may_fall))
        sys.stderr.write(f"{name}: {fell} / {aloft} of {len(outcomes)} flights\n")
        sys.stderr.flush()
        if options.verbose:
            for seed, outcome in enumerate(outcomes):
                if outcome.aloft or (outcome.fell and not may_fall):
                    sys.stderr.write(f"{name}: seed {seed}: {outcome}\n")
        return f"{fell} / {aloft}"

    with ProcessPoolExecutor(options.processes) as pool:
        for phase, whole in product(options.phases, (False, True)):
            row = []
            for length in options.lengths:
                fly = partial(_cut_flight, phase, length, whole)
                outcomes = campaign(fly, options.flights, pool)
                name = f"{phase}, {length:g} s, {'all' if whole else 'one'}"
                row.append(result(name, outcomes, may_fall=excused(phase, length)))
            lines.append(f"| {phase}, {'all' if whole else 'one'} | {' | '.join(row)} |")
        if options.phases == list(PHASES):
            link = result("bad link", campaign(bad_link_flight, options.flights, pool))
            lines += ["", f"20 % loss and 20 to 120 ms: {link}"]
    sys.stdout.write("\n".join(lines) + "\n")
    return int(bad)


def _cut_flight(phase: str, length: float, whole: bool, seed: int) -> Outcome:  # noqa: FBT001
    return cut_flight(phase, length, whole=whole, seed=seed)


if __name__ == "__main__":
    raise SystemExit(main())
