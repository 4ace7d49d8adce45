"""What the record of a flight costs, as a fraction of one core.

``python benchmarks/recording.py`` prints a table, with ``--json`` one JSON object. Ten drones fly
in real time at 20 Hz, with the observers `record` and `mcap` and without; the rounds alternate. The
cost is the processor time of the program and of the process that writes ``flight.mcap``, from the
beginning of the mission to its end with all files complete, less that without a record.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import statistics
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from star_core import Registry, fly, hookimpl, load

AGENTS = 10
RADIUS = 2.5  # m, of the circle that they change sides on
TRANSPORT = "{use: sim, speed: 1}"
GOAL = 10.0  # % of a core
ROUNDS = 3

HEAD = """\
star: 1
name: ten
world: room.yaml
transport: {transport}
localizer: flow
planner: straight
avoider: orca
swarm:
"""
STEPS = """\
mission:
  - takeoff: {height: 0.8}
  - repeat:
      times: 2
      steps:
        - parallel:
"""


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
    others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time(), others.ru_utime + others.ru_stime


def write(folder: Path) -> Path:
    """Write a mission of ten drones on a circle that change sides four times; return its file."""
    (folder / "room.yaml").write_text(
        "star: 1\nname: room\nfence: {low: [-4, -4, 0], high: [4, 4, 2.5]}\n"
    )
    lines = [HEAD.format(transport=TRANSPORT)]
    turns = []
    for i in range(AGENTS):
        angle = 2 * math.pi * i / AGENTS
        x, y = RADIUS * math.cos(angle), RADIUS * math.sin(angle)
        lines.append(f"  cf{i + 1}: {{start: [{x:.3f}, {y:.3f}, 0]}}\n")
        turns.append(f"            - goto: {{agents: cf{i + 1}, to: [{-x:.3f}, {-y:.3f}, 0.8]}}\n")
        turns.append(f"            - goto: {{agents: cf{i + 1}, to: [{x:.3f}, {y:.3f}, 0.8]}}\n")
    mission = folder / "ten.yaml"
    mission.write_text("".join([*lines, STEPS, *turns[::2], "        - parallel:\n", *turns[1::2]]))
    return mission


def cost(mission: Path, folder: Path | None) -> dict[str, float]:
    """Fly, and return processor times as percentages of the flight's time."""
    blocked = "" if folder else "record,mcap"
    with patch.dict(os.environ, {"STAR_BLOCK_PLUGINS": blocked}):
        registry = Registry(clock := Clock())
    summary = fly(load(mission, registry), registry, folder=folder)
    here, others = clock.used
    share = 100 / summary["flight_time_s"]
    return {
        "program": here * share,
        "writer": others * share,
        "flight_time_s": summary["flight_time_s"],
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="%(default)s")
    given = parser.parse_args()
    found: dict[str, list[dict[str, float]]] = {"recorded": [], "not recorded": []}
    with TemporaryDirectory() as name:
        mission = write(Path(name))
        for number in range(given.rounds):  # the first flight, a recorded one, loads the kernels
            found["recorded"].append(cost(mission, Path(name) / str(number)))
            found["not recorded"].append(cost(mission, None))
    table: Mapping[str, Any] = {
        kind: {key: statistics.median(one[key] for one in rows) for key in rows[0]}
        for kind, rows in found.items()
    }
    program = table["recorded"]["program"] - table["not recorded"]["program"]
    total = program + table["recorded"]["writer"]
    if given.json:
        print(json.dumps({"flights": table, "cost": total, "goal": GOAL}))
        return
    print("| 10 drones, 20 Hz, real time | program | process that writes |\n|---|---:|---:|")
    for kind, row in table.items():
        print(f"| {kind} | {row['program']:.1f} % | {row['writer']:.1f} % |")
    print(f"recording: {total:.1f} % of a core (goal: {GOAL:g} %)")


if __name__ == "__main__":
    main()
