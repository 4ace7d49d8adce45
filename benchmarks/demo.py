"""How many times faster than real time the first mission flies, again and again in one process.

``python benchmarks/demo.py`` prints a table, with ``--json`` one JSON object. The peer is real
time; reading the mission and starting Python are not in it, recording is not done.
"""

from __future__ import annotations

import statistics
import sys
from pathlib import Path

from printed import command_line, show

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
    options = command_line(__doc__, flights=25).parse_args()
    speeds = factors(options.flights)
    figures = {"first": speeds[0], "median": statistics.median(speeds), "best": max(speeds)}
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
