"""Flights of ``missions/around.yaml``: how many complete, and contacts by ground truth.

``make around`` prints the table of docs/methods.md, "Heights over obstacles". Flights begin with
seed 1000, in the default world: with noise, drift, aerodynamics, and a ranger that measures heights
above obstacles.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from star_core import Registry, fly, load
from tests.campaign.mocap import _silent

SEED = 1000
MISSION = Path(__file__).parents[2] / "missions" / "around.yaml"


class Flown(NamedTuple):
    """A flight.

    Attributes:
        seed: Of the flight.
        reason: Why it did not complete; empty if it did.
        contacts: Collisions with obstacles and between agents, by ground truth.
        clearance: Least distance to an obstacle, m.
        apart: Least distance between the agents, m.
        rms: RMS error of the estimated positions, m.
        nees: Of them.
    """

    seed: int
    reason: str
    contacts: int
    clearance: float
    apart: float
    rms: float
    nees: float


def flown(seed: int, changes: Sequence[str] = ()) -> Flown:
    """Fly the mission with a seed and with changes as of ``--set``, in this process."""
    registry = Registry()
    changes = [*changes, "localizer.processes=0", f"seed={seed}"]
    summary = fly(load(MISSION, registry, changes), registry)
    assert summary["distances_from"] == "ground_truth"
    completed = summary["outcome"] == "completed"
    return Flown(
        seed,
        "" if completed else str(summary["reason"] or summary["outcome"]),
        sum(summary["collisions"].values()),
        float(summary["min_clearance_m"]),
        float(summary["min_separation_m"]),
        float(summary["position_rmse_m"]),
        float(summary["position_nees"]),
    )


def main() -> None:
    """Print the table, and a line about each flight that failed or touched something."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=100, help="%(default)s")
    parser.add_argument("--first", type=int, default=SEED, help="seed; %(default)s")
    parser.add_argument("--processes", type=int, default=1, help="%(default)s")
    parser.add_argument("--set", dest="changes", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.flights)
    fly_seed = partial(flown, changes=options.changes)
    flights = []
    with ProcessPoolExecutor(options.processes, initializer=_silent) as pool:
        for flight in pool.map(fly_seed, seeds):
            flights.append(flight)
            if flight.reason or flight.contacts:
                reason = flight.reason or "completed"
                print(f"seed {flight.seed}: {flight.contacts} contacts; {reason}", flush=True)
    completed = sum(not flight.reason for flight in flights)
    clear = sum(not flight.contacts for flight in flights)
    clearance = sorted(flight.clearance for flight in flights)
    rms = [flight.rms for flight in flights]
    print("| flights | completed | without a contact | clearance, least (median), m ", end="")
    print("| apart, m | RMS (worst flight), cm | NEES |\n|---|---|---|---|---|---|---|")
    print(
        f"| {len(flights)} | {completed} | {clear} "
        f"| {clearance[0]:.2f} ({np.median(clearance):.2f}) "
        f"| {min(flight.apart for flight in flights):.2f} "
        f"| {100 * np.sqrt(np.mean(np.square(rms))):.1f} ({100 * max(rms):.1f}) "
        f"| {np.mean([flight.nees for flight in flights]):.2f} |"
    )


if __name__ == "__main__":
    main()
