"""Durations of rehearsals beside those of flights.

``python benchmarks/durations.py [MISSION ...]`` rehearses and flies missions in their own world,
with their own seed and the next ones, and prints a table with the mean of the flights: by default
of all missions that ship and their scenarios. With ``--steps`` it prints each step of each flight,
and at the end how much longer the steps of each verb took than in the rehearsal.
"""

from __future__ import annotations

import argparse
import statistics
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from star_core import Mission, Registry, fly, load
from star_core.toolkit import Rehearsal

MISSIONS = Path(__file__).parents[1] / "missions"
EXTERNAL = "external"  # needs a program that commands its agents
TOLERANCE = 0.1  # of the duration of the flight


class FlownStep(NamedTuple):
    """A step of a flight.

    Attributes:
        verb: Its verb.
        agents: Their names.
        rehearsed: Duration in the rehearsal, s; None if it was not rehearsed.
        flown: Duration, s.
    """

    verb: str
    agents: str
    rehearsed: float | None
    flown: float


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
    longer: defaultdict[str, list[float]] = defaultdict(list)  # s, by verb
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
            for step in steps(rehearsal, mission, summary):
                planned = "-" if step.rehearsed is None else f"{step.rehearsed:.1f}"
                print(f"|   {step.verb} {step.agents} | {planned} | {step.flown:.1f} | | | | |")
                if step.rehearsed is not None:
                    longer[step.verb].append(step.flown - step.rehearsed)
    for verb, seconds in longer.items():
        median = statistics.median(seconds)
        print(f"{verb}: {median:+.2f} s in flights, median of {len(seconds)} steps")


def steps(
    rehearsal: Rehearsal, mission: Mission, summary: Mapping[str, Any]
) -> Iterator[FlownStep]:
    """Yield each step that was flown."""
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
        if step is not None:
            waiting.remove(step)
        rehearsed = None if step is None else step.ended - step.begun
        took = flown["ended_s"] - flown["begun_s"]
        yield FlownStep(flown["verb"], ", ".join(names), rehearsed, took)


if __name__ == "__main__":
    main()
