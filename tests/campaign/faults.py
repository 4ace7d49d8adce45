"""The fault matrix: each cell flown with many seeds, and judged by the same policies.

A cell is a mission with faults at a random time and of a random agent. Every flight is flown as by
``star run MISSION --faults FILE``, and then watched for another 5 s without the program. The world
is the default one of `sim`, or the ideal one with ``--world ideal``. Flights are kept in a file for
each world and commit, which is written all the time: the same command again flies those that are
missing, also after an interrupt, and ``--page`` puts the table of all into a page. ``--minutes``
ends a piece of a campaign. What the flights that are missing will take is printed first, as far
as flights of the same cells have been measured.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import beta

from tests.campaign.fault_cells import CELLS
from tests.campaign.fault_flight import flown

SEEDS: Final = 30  # flights of each cell
MANY_SEEDS: Final = 300  # of the cells of some rows
MANY_ROWS: Final = ("1", "4", "11")  # lost links, localizers and avoiders
SAVING_PERIOD: Final = 10.0  # s between two writes of the results


def upper_bound(failures: int, flights: int) -> float:
    """Return the 95 % upper bound of a probability (Clopper and Pearson, one-sided).

    >>> round(upper_bound(0, 30), 3)
    0.095
    """
    return 1.0 if failures == flights else float(beta.ppf(0.95, failures + 1, flights - failures))


def table(results: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table."""
    heads = "row", "fault", "n", "broken", "≤ (95 %)", "policies", "exit status", "nearest", "down"
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for cell in CELLS:
        flights = [flight for key, flight in results.items() if key.rpartition("/")[0] == cell.name]
        if not flights:
            continue
        n, bad = len(flights), sum(bool(flight["broken"]) for flight in flights)
        policies = Counter(name for flight in flights for name in flight["broken"])
        policy_counts = ", ".join(f"{name} {count}" for name, count in policies.most_common())
        statuses = ", ".join(
            f"{k}: {v}" for k, v in sorted(Counter(f["status"] for f in flights).items())
        )
        nearest = min((flight.get("nearest", np.inf) for flight in flights), default=np.inf)
        down = max((flight.get("down", 0.0) for flight in flights), default=0.0)
        yield (
            f"| {cell.row} | {cell.name} | {n} | {bad} | {100 * upper_bound(bad, n):.0f} % "
            f"| {policy_counts} | {statuses} | {f'{nearest:.2f} m' if nearest < np.inf else ''} "
            f"| {f'{down:.1f} s' if down else ''} |"
        )


def fly_missing(
    results: dict[str, Any], missing: Sequence[tuple[int, int]], options: argparse.Namespace
) -> None:
    """Fly cells with seeds in processes; add what happened to the results and their file.

    Args:
        results: By name of the cell and seed.
        missing: Indices of cells and seeds.
        options: Of the command line.
    """
    made_at = _commit()
    end, saved = time.monotonic() + 60 * options.minutes, time.monotonic()
    with ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:
        flights = {
            pool.submit(_flown, index, seed, options.world, end): f"{CELLS[index].name}/{seed}"
            for index, seed in missing
        }
        for flight in as_completed(flights):
            key, verdict = flights[flight], flight.result()
            if verdict is None:
                continue
            results[key] = verdict
            if verdict["broken"]:
                print(key, verdict["broken"], file=sys.stderr, flush=True)
            if time.monotonic() >= saved + SAVING_PERIOD:
                saved = time.monotonic()
                _save(options, made_at, results)
    _save(options, made_at, results)


def _flown(index: int, seed: int, world: str, end: float) -> dict[str, Any] | None:
    if time.monotonic() >= end:
        return None
    return flown(CELLS[index], seed, world)  # the cell itself cannot be sent to a process


def _save(options: argparse.Namespace, commit: str, results: Mapping[str, Any]) -> None:
    content = {"commit": commit, "world": options.world, "flights": results}
    part = options.results.with_suffix(".part")
    part.write_text(json.dumps(content, indent=1), encoding="utf-8")
    part.replace(options.results)


def _load(options: argparse.Namespace, commit: str) -> dict[str, Any]:
    """Return the flights in the file of the results, which must be of this commit and world."""
    if not options.results.exists():
        return {}
    content: dict[str, Any] = json.loads(options.results.read_text(encoding="utf-8"))
    if (content.get("commit"), content.get("world")) != (commit, options.world):
        sys.exit(f"{options.results} is not of commit {commit} in the {options.world} world")
    flights: dict[str, Any] = content["flights"]
    return flights


def _commit() -> str:
    command = "git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"
    return subprocess.run(
        [*command, "--exclude=*"], capture_output=True, text=True, check=True
    ).stdout.strip()


def costs(results: Mapping[str, Any], missing: Sequence[tuple[int, int]]) -> Iterator[str]:
    """Yield what the missing flights of each row take, by flights of their cells in the results."""
    measured: dict[str, list[float]] = {}
    for key, flight in results.items():
        measured.setdefault(key.rpartition("/")[0], []).append(flight.get("cpu_s", 0.0))
    total = 0.0
    for row in dict.fromkeys(cell.row for cell in CELLS):
        names = [CELLS[index].name for index, _ in missing if CELLS[index].row == row]
        means = [np.mean(measured[name]) for name in names if name in measured]
        seconds = float(np.mean(means)) * len(names) if means else 0.0
        total += seconds
        if names:
            took = f"{seconds / 60:.0f} min of processor time" if means else "not measured yet"
            yield f"row {row}: {len(names)} flights, {took}"
    if total:
        yield f"all that is measured: {total / 3600:.1f} h of processor time"


def main() -> None:
    """Fly what is missing, and print the table."""
    os.environ.setdefault("STAR_BLOCK_PLUGINS", "mcap")  # it starts a process for each flight
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    many = f"{MANY_SEEDS} in rows {', '.join(MANY_ROWS)}, {SEEDS} in the others"
    parser.add_argument("--seeds", type=int, help=f"of each cell; if not given, {many}")
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--cells", default="", help="fly only cells whose names contain this")
    parser.add_argument("--rows", nargs="*", help="fly only these rows")
    parser.add_argument("--world", choices=("default", "ideal"), default="default")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no flight later")
    parser.add_argument("--estimate", action="store_true", help="only print what it would take")
    parser.add_argument("--results", type=Path, help="runs/faults-WORLD-COMMIT.json if not given")
    parser.add_argument("--page", type=Path, help="put the table into this page")
    options = parser.parse_args()
    commit = _commit()
    options.results = options.results or Path(f"runs/faults-{options.world}-{commit}.json")
    options.results.parent.mkdir(parents=True, exist_ok=True)
    results = _load(options, commit)
    missing = [
        (index, options.first + k)
        for k in range(options.seeds or MANY_SEEDS)
        for index, cell in enumerate(CELLS)
        if k < min(cell.most, options.seeds or (MANY_SEEDS if cell.row in MANY_ROWS else SEEDS))
        and options.cells in cell.name
        and (not options.rows or cell.row in options.rows)
        and f"{cell.name}/{options.first + k}" not in results
    ]
    print(*costs(results, missing), sep="\n", file=sys.stderr, flush=True)
    if options.estimate:
        return
    fly_missing(results, missing, options)
    rows = "\n".join(table(results))
    print(rows)
    if options.page:
        text = options.page.read_text(encoding="utf-8")
        before, _, rest = text.partition("<!-- table -->\n")
        _, _, after = rest.partition("<!-- end -->\n")
        options.page.write_text(
            f"{before}<!-- table -->\n{rows}\n\n<!-- end -->\n{after}", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
