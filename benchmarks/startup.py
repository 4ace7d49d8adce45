"""How long the command line takes to start, and what a first flight compiles.

The figures of the start are medians over rounds of the ratio, in one round, of a command's wall
time to that of ``python -c pass`` with the same interpreter. Compilation is the processor time of a
flight with an empty cache of kernels less that of the same flight with a full one.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
STAR = Path(sys.executable).with_name("star")
MISSION = ROOT / "missions" / "first_flight.yaml"
COMMANDS = {
    "help": [str(STAR), "--help"],
    "check": [str(STAR), "check", str(MISSION)],
    "plugins": [str(STAR), "plugins"],
}
GOALS = {"help": 3.0, "check": 35.0, "compile_cpu_s": 10.0, "longest_silence_s": 2.0}


def seconds(command: list[str]) -> float:
    """Return the wall time of a command, s."""
    begun = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - begun


def figures(rounds: int) -> dict[str, float]:
    """Return the ratios, and the time of an empty program beside them, ms."""
    python = [sys.executable, "-c", "pass"]
    ratios: dict[str, list[float]] = {name: [] for name in COMMANDS}
    empty = []
    for command in [python, *COMMANDS.values()]:
        seconds(command)  # once, so that files are in memory
    for _ in range(rounds):
        for name, command in COMMANDS.items():
            base = seconds(python)
            empty.append(base)
            ratios[name].append(seconds(command) / base)
    answer = {f"{name}_over_python": statistics.median(r) for name, r in ratios.items()}
    return answer | {"python_ms": statistics.median(empty) * 1e3}


def first_flight() -> dict[str, float]:
    """Return the compilation's processor time, and the longest time without any output, s."""
    with TemporaryDirectory() as folder:
        first, silence = flight(folder)
        second, _ = flight(folder)
    return {"compile_cpu_s": first - second, "longest_silence_s": silence}


def flight(cache: str) -> tuple[float, float]:
    """Return the processor time of a flight and its longest time without output, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    output = time.perf_counter()
    silence = 0.0
    with subprocess.Popen(
        [str(STAR), "run", str(MISSION), "--no-record"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=os.environ | {"NUMBA_CACHE_DIR": cache},
    ) as process:
        assert process.stdout is not None
        for _ in process.stdout:
            now = time.perf_counter()
            silence, output = max(silence, now - output), now
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, silence


def main() -> None:
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--json", action="store_true", help="print one JSON object, only")
    options.add_argument("--rounds", type=int, default=15)
    given = options.parse_args()
    found = figures(given.rounds) | first_flight()
    if given.json:
        print(json.dumps(found))
        return
    for name, value in found.items():
        goal = GOALS.get(name.removesuffix("_over_python"))
        print(f"{name:24} {value:8.2f}" + (f"   (goal: at most {goal:g})" if goal else ""))


if __name__ == "__main__":
    main()
