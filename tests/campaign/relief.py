"""Whether reserves keep a search manned for half an hour on batteries of four minutes.

It flies ``missions/relief.yaml`` with so many rounds that they last half an hour, once for each
seed, with the errors of the simulator's estimators and cameras. An agent searches in a tick if it
is in a step ``search``, in the air, and located; climbs and ways home are no search. Times are of
the mission: no machine makes them shorter.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from star_core import AgentPhase, Flight, Registry, Tick, fly, hookimpl, load
from star_core.discovery import Source

# The world of the published figures, with voltages for its batteries, which sag less.
IDEAL = (
    "limits.uncertainty_margin=0",
    "transport.profile=ideal",
    "transport.controller=ideal",
    "reserve.relieve_below=3.72",
    "safety.battery_low.below=3.3",
)
MISSION = Path(__file__).parents[2] / "missions" / "relief.yaml"
ROUNDS = 32  # searches, one after the other
HALF_AN_HOUR = 1800.0  # s
SEEDS = 20
MANNED = 3  # agents that should search at any time
GOAL_GAP = 10.0  # s with fewer of them, at most


class Watched(NamedTuple):
    """One flight.

    Attributes:
        seed: Its seed.
        outcome: Of the mission.
        searched_s: From the beginning of the first search to the end of the last, s.
        least: Fewest agents that searched in any tick of that.
        gap_s: Longest time with fewer than `MANNED`, s.
        unmanned_s: All such time, s.
        full_share: Share of the time with four or more.
        reliefs: How often a reserve took over.
        hits: Collisions.
        nearest_m: Least distance between two agents, m.
        rounds: Searches that were done.
        reason: Why it did not complete.
    """

    seed: int
    outcome: str
    searched_s: float
    least: int
    gap_s: float
    unmanned_s: float
    full_share: float
    reliefs: int
    hits: int
    nearest_m: float
    rounds: int
    reason: str


class Watch:
    """Counts the agents that search.

    Attributes:
        times: Of the ticks from the beginning of the first search to the end of the last, s.
        counts: How many searched in each.
    """

    def __init__(self) -> None:
        self.times: list[float] = []
        self.counts: list[int] = []
        self._names: tuple[str, ...] = ()

    @hookimpl
    def star_mission_started(self, flight: Flight) -> None:
        self._names = flight.scene.names

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        verb, _, names = tick.doing.partition(" ")
        if verb == "search":  # the mission's steps follow one another
            searching = set(names.split(", "))
            rows = [row for row, name in enumerate(self._names) if name in searching]
            flies = tick.health.phase[rows] == AgentPhase.FLYING
            self.times.append(tick.time)
            self.counts.append(int((flies & tick.estimate.valid[rows]).sum()))


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="how many; default %(default)s")
    parser.add_argument("--first", type=int, default=0, help="first seed; default %(default)s")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="default %(default)s")
    arguments = parser.parse_args()
    flights = []
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        flights.append(flown(seed, arguments.rounds))
        if not arguments.json:
            print(*(f"{k}={v}" for k, v in flights[-1]._asdict().items()), flush=True)
    values = figures(flights)
    if arguments.json:
        print(json.dumps(values))
        return
    goals = {"longest_gap_s": f"at most {GOAL_GAP:g}", "collisions": "0", "completed": "1"}
    for name, value in values.items():
        goal = f"   (goal: {goals[name]})" if name in goals else ""
        print(f"{name:20} {value:10.4g}{goal}")


def flown(seed: int, rounds: int) -> Watched:
    """Fly the mission once."""
    registry, watch = Registry(), Watch()
    registry.add(watch, Source("benchmark:watch", "0"))
    changes = [f"seed={seed}", f"mission.1.repeat.times={rounds}", *IDEAL]
    summary = fly(load(MISSION, registry, changes), registry)
    time, count = np.array(watch.times), np.array(watch.counts)
    lasts = np.diff(time, append=time[-1])
    events = [event["text"] for event in summary["events"] if event["kind"] == "relief"]
    steps = [step for step in summary["steps"] if step["verb"] == "search"]
    return Watched(
        seed,
        summary["outcome"],
        round(float(time[-1] - time[0]), 1),
        int(count.min()),
        round(longest(time, count < MANNED), 2),
        round(float(lasts[count < MANNED].sum()), 2),
        round(float(lasts[count > MANNED].sum() / lasts.sum()), 4),
        sum(text.endswith("takes over") for text in events),
        sum(summary["collisions"].values()),
        round(summary["min_separation_m"], 3),
        sum(step["outcome"] == "success" for step in steps),
        summary["reason"],
    )


def longest(time: np.ndarray, few: np.ndarray) -> float:
    """Return the longest time for which something is so without a break, s.

    Args:
        time: (K,) of the ticks, s.
        few: (K,) whether it is so from each to the next.
    """
    most, since = 0.0, None
    for now, so in zip(time.tolist(), few.tolist(), strict=True):
        if since is not None:
            most = max(most, now - since)
        if not so:
            since = None
        elif since is None:
            since = now
    return most


def figures(flights: list[Watched]) -> dict[str, float]:
    """Sum up the flights."""
    return {
        "flights": len(flights),
        "completed": sum(f.outcome == "completed" for f in flights) / len(flights),
        "half_an_hour": sum(f.searched_s >= HALF_AN_HOUR for f in flights) / len(flights),
        "searched_least_s": min(f.searched_s for f in flights),
        "least_searching": min(f.least for f in flights),
        "longest_gap_s": max(f.gap_s for f in flights),
        "four_or_more": min(f.full_share for f in flights),
        "collisions": sum(f.hits for f in flights),
        "nearest_m": min(f.nearest_m for f in flights),
        "reliefs": sum(f.reliefs for f in flights) / len(flights),
    }


if __name__ == "__main__":
    main()
