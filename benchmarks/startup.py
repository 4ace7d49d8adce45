"""How long the command line takes to start, and what a first flight compiles.

The figures of the start are medians over rounds of the ratio, in one round, of a command's wall
time to that of ``python -c pass`` with the same interpreter. Processor times are the least of the
rounds: other programs on the computer only add to them. Compilation is the processor time of a
flight with an empty cache of kernels less that of the same flight with a full one. Python's byte
code is written once, to a folder of the benchmark.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from printed import command_line, show

ROOT = Path(__file__).parents[1]
STAR = Path(sys.executable).with_name("star")
MISSION = ROOT / "missions" / "first_flight.yaml"
COMMANDS = {
    "help": [str(STAR), "--help"],
    "check": [str(STAR), "check", str(MISSION)],
    "plugins": [str(STAR), "plugins"],
}
GOALS = {
    "help_over_python": 3.0,
    "check_over_python": 35.0,
    "check_cpu_s": 0.25,
    "run_cpu_s": 1.6,
    "compile_cpu_s": 10.0,
    "longest_silence_s": 2.0,
}


def seconds(command: list[str]) -> tuple[float, float]:
    """Return the wall time and the processor time of a command, s."""
    begun, used = time.perf_counter(), processor_time()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - begun, processor_time() - used


def processor_time() -> float:
    """Return the processor time of all commands so far, s."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def figures(rounds: int) -> dict[str, float]:
    """Return the ratios, the time of an empty program beside them, ms, and processor times, s."""
    python = [sys.executable, "-c", "pass"]
    ratios: dict[str, list[float]] = {name: [] for name in COMMANDS}
    used: dict[str, list[float]] = {name: [] for name in COMMANDS}
    empty = []
    for command in [python, *COMMANDS.values()]:
        seconds(command)  # once, so that files are in memory
    for _ in range(rounds):
        for name, command in COMMANDS.items():
            base, _ = seconds(python)
            empty.append(base)
            elapsed, processor = seconds(command)
            ratios[name].append(elapsed / base)
            used[name].append(processor)
    answer = {f"{name}_over_python": statistics.median(r) for name, r in ratios.items()}
    answer["python_ms"] = statistics.median(empty) * 1e3
    return answer | {f"{name}_cpu_s": min(times) for name, times in used.items()}


def first_flight(rounds: int) -> dict[str, float]:
    """Return processor times, s, and the longest time without any output in a first flight, s."""
    first, later, silences = [], [], []
    for _ in range(max(rounds // 5, 1)):
        with TemporaryDirectory() as folder:
            used, silence = flight(folder)
            first.append(used)
            silences.append(silence)
            later += [flight(folder)[0] for _ in range(2)]
    least, shortest = min(first), min(later)
    return {
        "run_cpu_s": shortest,
        "compile_cpu_s": least - shortest,
        "longest_silence_s": statistics.median(silences),
    }


def flight(cache: str) -> tuple[float, float]:
    """Return the processor time of a flight and its longest time without output, s."""
    used = processor_time()
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
    return processor_time() - used, silence


def main() -> None:
    """Print the figures."""
    options = command_line(__doc__, rounds=15).parse_args()
    with TemporaryDirectory() as folder, patch.dict(os.environ, PYTHONPYCACHEPREFIX=folder):
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        measured = figures(options.rounds) | first_flight(options.rounds)
    show(measured, as_json=options.json, goals=GOALS)


if __name__ == "__main__":
    main()
