"""Durations of rehearsals beside those of flights.

``python benchmarks/durations.py [MISSION ...]`` rehearses and flies missions in their own world,
with their own seed and the next ones, and prints a table with the mean of the flights: by default
of all missions that ship and their scenarios. With ``--steps`` it prints each step of each flight.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from star_core import Mission, Registry, fly, load
from star_core.toolkit import Rehearsal

MISSIONS = Path(__file__).parents[1] / "missions"
EXTERNAL = "external"  # needs a program that commands its agents
TOLERANCE = 0.1  # of the duration of the flight


def main() -> None:
    """Print the table of the missions on the command line."""
    line = argparse.ArgumentParser(description=__doc__)
    line.add_argument("missions", nargs="*", type=Path, help="mission files (all that ship)")
    line.add_argument("--steps", action="store_true", help="print each step, too")
    line.add_argument("--seeds", type=int, default=1, metavar="N", help="flights of each (1)")
    options = line.parse_args()
    shipped = [*sorted(MISSIONS.glob("*.yaml")), *sorted(MISSIONS.glob("scenarios/*.yaml"))]
    paths = options.missions or [path for path in shipped if path.stem != EXTERNAL]
    print("| mission | rehearsed, s | flown, s | from | to | error | |")
    print("|---|---:|---:|---:|---:|---:|---|")
    for path in paths:
        registry = Registry()
        mission = load(path, registry)
        rehearsal = registry.manager.hook.star_rehearse(mission=mission, registry=registry)
        summaries = [
            fly(mission.with_seed(mission.scene.seed + k), Registry()) for k in range(options.seeds)
        ]
        flown = [max(step["ended_s"] for step in summary["steps"]) for summary in summaries]
        mean = statistics.mean(flown)
        error = rehearsal.time[-1] / mean - 1
        note = "" if abs(error) <= TOLERANCE else "more than 10 %"
        numbers = f"{rehearsal.time[-1]:.1f} | {mean:.1f} | {min(flown):.1f} | {max(flown):.1f}"
        print(f"| {path.stem} | {numbers} | {error:+.0%} | {note} |", flush=True)
        for summary in summaries if options.steps else ():
            for text in steps(rehearsal, mission, summary):
                print(text)


def steps(rehearsal: Rehearsal, mission: Mission, summary: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line for each step that was flown, with its duration in rehearsal and flight, s."""
    waiting = list(rehearsal.steps)
    for flown in summary["steps"]:
        names = flown["agents"]
        same = (
            step
            for step in waiting
            if step.action.location == flown["location"]
            and [mission.scene.agents[row].name for row in step.rows] == names
        )
        step = next(same, None)
        planned = "-"
        if step is not None:
            waiting.remove(step)
            planned = f"{step.ended - step.begun:.1f}"
        took = flown["ended_s"] - flown["begun_s"]
        yield f"|   {flown['verb']} {', '.join(names)} | {planned} | {took:.1f} | | | | |"


if __name__ == "__main__":
    main()
