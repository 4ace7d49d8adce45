"""How many times faster than real time the first mission flies, again and again in one process.

``python benchmarks/demo.py`` prints a table, with ``--json`` one JSON object. The peer is real
time; reading the mission and starting Python are not in it, recording is not done.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from pathlib import Path

from star_core import Registry, fly, load

MISSION = Path(__file__).parents[1] / "missions" / "first_flight.yaml"


def factors(flights: int) -> list[float]:
    """Return how many times faster than real time each of some flights was.

    Raises:
        SystemExit: One did not complete.
    """
    registry = Registry()
    answer = []
    for _ in range(flights):
        summary = fly(load(MISSION, registry), registry)
        if summary["outcome"] != "completed":
            sys.exit(f"{summary['outcome']}: {summary['reason']}")
        answer.append(summary["realtime_factor"])
    return answer


def main() -> None:
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--json", action="store_true", help="print one JSON object, only")
    options.add_argument("--flights", type=int, default=25)
    given = options.parse_args()
    found = factors(given.flights)
    figures = {"first": found[0], "median": statistics.median(found), "best": max(found)}
    if given.json:
        print(json.dumps(figures))
        return
    for name, factor in figures.items():
        print(f"{name:8}{factor:8.1f} times real time")


if __name__ == "__main__":
    main()
