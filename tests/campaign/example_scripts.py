"""Running the example scripts of other projects, which an environment variable names.

They are copied, run unmodified, and judged by how they end and by what they print.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

PATIENCE = 150.0  # s, for an example that ends by itself
LANDING = 15.0  # s, for one to end after Ctrl-C
STARTED = re.compile(r"^star: fleet: .* is ", re.MULTILINE)  # a link of the example is open


class Run(NamedTuple):
    """How an example is run.

    Attributes:
        arguments: Of the command line.
        keys: What is typed.
        endless: Time after which it is interrupted, s; 0 for one that ends by itself.
        shows: Regular expression that its output must match.
    """

    arguments: tuple[str, ...] = ()
    keys: str = ""
    endless: float = 0.0
    shows: str = ""


class Result(NamedTuple):
    """What became of an example.

    Attributes:
        name: Path in the folder.
        outcome: ``runs``, ``fails`` or ``elsewhere``.
        reason: Of the outcome.
        output: All that it printed.
    """

    name: str
    outcome: str
    reason: str
    output: str = ""


def campaign(
    description: str,
    variable: str,
    names: Callable[[Path], Iterable[str]],
    run: Callable[[Path, str], Result],
    *,
    prepare: Callable[[Path], object],
) -> tuple[list[Result], bool]:
    """Run examples, and print a line for each, a table and a summary.

    Args:
        description: For ``--help``.
        variable: Environment variable that names the folder of the examples.
        names: Returns their names, given the copy of that folder.
        run: Runs one, given the parent of that copy and its name.
        prepare: Writes what they need, given that parent.

    Returns:
        The results, and whether all examples were to be run.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("examples", nargs="*", help="only those whose path contains one of these")
    parser.add_argument("--jobs", type=int, default=2, help="at the same time; %(default)s")
    parser.add_argument("--output", action="store_true", help="print the output of failures")
    arguments = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # where it is ignored, as after `&`
    if not (folder := os.environ.get(variable)):
        print(f"{variable} names no folder with examples: left out")
        return [], False
    results = []
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        shutil.copytree(folder, root / "examples")
        prepare(root)
        scripts = [
            e
            for e in names(root / "examples")
            if not arguments.examples or any(part in e for part in arguments.examples)
        ]
        with ThreadPoolExecutor(arguments.jobs) as pool:
            for result in pool.map(lambda each: run(root, each), scripts):
                results.append(result)
                print(f"{result.outcome:10}{result.name:60}{result.reason}", flush=True)
                if arguments.output and result.outcome == "fails":
                    print(result.output)
    print(table(results))
    counts = Counter(result.outcome for result in results)
    print(f"examples {len(results)}:", ", ".join(f"{n} {o}" for o, n in counts.most_common()))
    return results, not arguments.examples


def table(results: Sequence[Result]) -> str:
    """Return a table: by folder, how many run, and what the others need."""
    lines = ["| folder | examples | run | the others |", "|---|---|---|---|"]
    folders = {result.name.rpartition("/")[0] for result in results}
    for folder in sorted(folders):
        rows = [result for result in results if result.name.rpartition("/")[0] == folder]
        failures = [
            f"`{row.name.rpartition('/')[2]}`: {row.reason}"
            for row in rows
            if row.outcome != "runs"
        ]
        count = len(rows) - len(failures)
        lines.append(f"| {folder or '.'} | {len(rows)} | {count} | {'; '.join(failures)} |")
    return "\n".join(lines)


def output_of(command: Sequence[str], script: Path, case: Run) -> tuple[str, str]:
    """Run a command in the folder of its script; return what was wrong and what it printed."""
    log = script.with_suffix(f"{script.suffix}.output")
    with log.open("wb") as output:
        process = subprocess.Popen(
            command,
            cwd=script.parent,
            env={**os.environ, "MPLBACKEND": "Agg"},
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        assert process.stdin is not None
        process.stdin.write(case.keys.encode())
        process.stdin.close()
        reason = ended(process, log, case)
    return reason, log.read_text(errors="replace")


def ended(process: subprocess.Popen[bytes], log: Path, case: Run) -> str:
    """Wait for an example's end, interrupting one that is endless; return what was wrong."""
    deadline = time.monotonic() + PATIENCE
    while not STARTED.search(log.read_text(errors="replace")):
        if process.poll() is not None:
            return f"exit status {process.returncode}" if process.returncode or case.endless else ""
        if time.monotonic() > deadline:
            break
        time.sleep(0.2)
    try:
        if not case.endless:
            process.wait(max(0.0, deadline - time.monotonic()))
            return f"exit status {process.returncode}" if process.returncode else ""
        time.sleep(case.endless)
        if process.poll() is not None:
            return f"exit status {process.returncode}"
        os.killpg(process.pid, signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(LANDING)  # a thread of it may go on, as it does by radio
            return ""
        process.terminate()
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return f"still running after {PATIENCE:.0f} s"
    return ""
