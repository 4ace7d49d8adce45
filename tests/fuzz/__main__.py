"""Fuzzing of everything that STAR reads: ``python -m tests.fuzz`` prints the table of the results.

Names of targets select some, ``--skip`` leaves one out; ``--times 10`` tries ten times as many
inputs, ``--seed`` others.
``--only NUMBER`` repeats one input of a target, with its traceback. The exit status is 1 if there
is a defect.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.fuzz.harness import Target, run
from tests.fuzz.targets import TARGETS

HEAD = ("target", "inputs", "outcomes", "defects", "slowest (s)", "memory (MB)", "time (s)")


def main() -> int:
    options = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    options.add_argument("targets", nargs="*", help=", ".join(target.name for target in TARGETS))
    options.add_argument("--skip", action="append", default=[], help="a target to leave out")
    options.add_argument("--times", type=float, default=1.0, help="times the usual inputs (1)")
    options.add_argument("--seed", type=int, default=1, help="of all inputs (1)")
    options.add_argument("--only", type=int, metavar="NUMBER", help="try one input")
    options.add_argument("--json", action="store_true", help="print one JSON object, only")
    arguments = options.parse_args()
    if unknown := {*arguments.targets, *arguments.skip} - {target.name for target in TARGETS}:
        options.error(f"no target named {', '.join(sorted(unknown))}")
    chosen = [
        target
        for target in TARGETS
        if (not arguments.targets or target.name in arguments.targets)
        and target.name not in arguments.skip
    ]
    if not arguments.json:
        sys.stdout.write(f"| {' | '.join(HEAD)} |\n{'|---' * len(HEAD)}|\n")
    rows = {target.name: _tried(target, arguments) for target in chosen}
    if arguments.json:
        table = {name: dict(zip(HEAD[1:], row, strict=True)) for name, row in rows.items()}
        sys.stdout.write(json.dumps(table) + "\n")
    return any(row[2] for row in rows.values())


def _tried(
    target: Target, arguments: argparse.Namespace
) -> tuple[int, str, int, float, float, float]:
    """Try the inputs of a target, print its row and its defects, and return the row."""
    first, count = 0, max(1, round(target.many * arguments.times))
    if arguments.only is not None:
        first, count = arguments.only, 1
    with TemporaryDirectory() as folder:
        report = run(target, Path(folder), count, arguments.seed, first=first)
    outcomes = ", ".join(f"{name} {n}" for name, n in sorted(report.outcomes.items()))
    row = (
        report.outcomes.total(), outcomes, len(report.defects), round(report.slowest, 2),
        round(report.growth / 1e6), round(report.took, 1),
    )  # fmt: skip
    for number, text in report.defects.values():
        sys.stderr.write(f"\n{target.name}, input {number} of seed {arguments.seed}:\n{text}\n")
    if not arguments.json:
        sys.stdout.write(f"| {' | '.join(map(str, (target.name, *row)))} |\n")
        sys.stdout.flush()
    return row


if __name__ == "__main__":
    sys.exit(main())
