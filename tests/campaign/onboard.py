"""Flights by Lighthouse, Loco and received poses: errors of positions, and what a loss causes.

``make onboard`` prints the table of docs/lighthouse.md. Flights begin with seed 1000.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tests.campaign.mocap import Accuracy, _silent, accuracy, flown

Holds: TypeAlias = Callable[[int], bool]
SEED = 1000
MISSIONS = Path(__file__).parents[2] / "missions"
LIGHTHOUSE = MISSIONS / "lighthouse.yaml"
POSES = ("transport.onboard.system=poses", "localizer.system=poses")
SYSTEMS = {
    "lighthouse": (LIGHTHOUSE, ()),
    "loco": (MISSIONS / "loco.yaml", ()),
    "poses": (LIGHTHOUSE, POSES),
}
BEGINS = 3.5  # s, of a loss: in flight


def of_system(seed: int, name: str) -> Accuracy:
    """Fly a mission by a system, and return its figures."""
    path, assignments = SYSTEMS[name]
    return accuracy(seed, assignments, path)


def never_received(seed: int) -> bool:
    """Whether no agent takes off while one of them receives no system."""
    fault = {"component": "positioning", "mode": "off", "agents": "cf2"}
    flight = flown(LIGHTHOUSE, seed, (), [fault])
    return not flight.completed and flight.highest < 0.05


def lost(seed: int) -> bool:
    """Whether an agent that receives nothing from 3.5 s on is landed before it is 0.5 m off."""
    fault = {"component": "positioning", "mode": "off", "at": BEGINS, "agents": "cf1"}
    flight = flown(LIGHTHOUSE, seed, (), [fault])
    reacted = flight.when("cf1", "position_lost")
    return reacted < np.inf and flight.worst < 0.5


def main() -> None:
    """Print the table of docs/lighthouse.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=30, help="of each system; %(default)s")
    parser.add_argument("--first", type=int, default=SEED, help="seed; %(default)s")
    parser.add_argument("--processes", type=int, default=1, help="%(default)s")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.flights)
    with ProcessPoolExecutor(options.processes, initializer=_silent) as pool:
        print("| system | RMS (worst flight), cm | worst, cm | NEES (flights) |\n|---|---|---|---|")
        for name in SYSTEMS:
            flights = np.array(list(pool.map(partial(of_system, name=name), seeds)))
            rms = 100 * np.sqrt(np.mean(flights[:, 0] ** 2))
            print(
                f"| {name} | {rms:.1f} ({100 * flights[:, 0].max():.1f}) "
                f"| {100 * flights[:, 1].max():.1f} | {flights[:, 2].mean():.2f} "
                f"({flights[:, 2].min():.2f}-{flights[:, 2].max():.2f}) |",
                flush=True,
            )
        for holds in (never_received, lost):
            print(f"{holds.__name__}: {sum(pool.map(holds, seeds))} of {len(seeds)}", flush=True)


if __name__ == "__main__":
    main()
