"""What the record of a flight costs, as a fraction of one core.

``python benchmarks/recording.py`` prints a table, with ``--json`` one JSON object. Ten drones fly
in real time at 20 Hz, with the observers `record` and `mcap` and without; the rounds alternate. The
cost is the processor time of the program and of the process that writes ``flight.mcap``, from the
beginning of the mission to its end with all files complete, less that without a record.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from circle import write
from printed import command_line

from star_core import Registry, fly, hookimpl, load

AGENTS = 10
RADIUS = 2.5  # m, of the circle that they change sides on
TURNS = 4
TRANSPORT = "{use: sim, speed: 1}"
GOAL = 10.0  # % of a core
ROUNDS = 3


class Clock:
    """Reads the processor's clock when a mission begins and when its record is complete."""

    def __init__(self) -> None:
        self._begun = self._took = (0.0, 0.0)

    @property
    def used(self) -> tuple[float, float]:
        """Processor time of this process and of those that it has started, s."""
        return self._took[0] - self._begun[0], self._took[1] - self._begun[1]

    @hookimpl(tryfirst=True)
    def star_mission_started(self) -> None:
        self._begun = _clocks()

    @hookimpl(trylast=True)
    def star_mission_ended(self) -> None:
        self._took = _clocks()


def _clocks() -> tuple[float, float]:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time(), children.ru_utime + children.ru_stime


def cost(mission: Path, folder: Path | None) -> dict[str, float]:
    """Fly, and return processor times as percentages of the flight's time."""
    blocked = "" if folder else "record,mcap"
    with patch.dict(os.environ, {"STAR_BLOCK_PLUGINS": blocked}):
        registry = Registry(clock := Clock())
    summary = fly(load(mission, registry), registry, folder=folder)
    program, writer = clock.used
    share = 100 / summary["flight_time_s"]
    return {
        "program": program * share,
        "writer": writer * share,
        "flight_time_s": summary["flight_time_s"],
    }


def main() -> None:
    """Print the figures."""
    options = command_line(__doc__, rounds=ROUNDS).parse_args()
    costs: dict[str, list[dict[str, float]]] = {"recorded": [], "not recorded": []}
    with TemporaryDirectory() as name:
        mission = write(Path(name), AGENTS, RADIUS, TRANSPORT, TURNS)
        for number in range(options.rounds):  # the first flight, a recorded one, loads the kernels
            costs["recorded"].append(cost(mission, Path(name) / str(number)))
            costs["not recorded"].append(cost(mission, None))
    table: Mapping[str, Any] = {
        kind: {key: statistics.median(row[key] for row in rows) for key in rows[0]}
        for kind, rows in costs.items()
    }
    program = table["recorded"]["program"] - table["not recorded"]["program"]
    total = program + table["recorded"]["writer"]
    if options.json:
        print(json.dumps({"flights": table, "cost": total, "goal": GOAL}))
        return
    print("| 10 drones, 20 Hz, real time | program | process that writes |\n|---|---:|---:|")
    for kind, row in table.items():
        print(f"| {kind} | {row['program']:.1f} % | {row['writer']:.1f} % |")
    print(f"recording: {total:.1f} % of a core (goal: {GOAL:g} %)")


if __name__ == "__main__":
    main()
