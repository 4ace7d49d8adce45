"""Command line of ``star run``."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentError, ArgumentParser, Namespace
from contextlib import nullcontext, redirect_stdout, suppress
from typing import Final

from star_basics.mission_arguments import add_mission, assignments
from star_core import Operator, Registry
from star_core.formats import printable
from star_core.toolkit import Progress, log, on_terminal, unescaped

RED: Final = "\x1b[1;31m"
GREEN: Final = "\x1b[1;32m"
PLAIN: Final = "\x1b[0m"


def configure(registry: Registry, line: ArgumentParser) -> None:
    """Add the options of the command, then those of plugins."""
    add_mission(line)
    line.add_argument("--out", metavar="DIR", help="record into DIR (runs/TIME-MISSION)")
    line.add_argument("--no-record", action="store_true", help="leave nothing behind")
    line.add_argument("--save-frames", action="store_true", help="keep the cameras' images too")
    line.add_argument("--json", action="store_true", help="print the summary as JSON, only")
    line.add_argument("--verbose", action="store_true", help="show the tracebacks of plugins")
    for name, spec in registry.offers()["run_option"].items():
        flag = f"--{name}"
        value = (
            {"action": "store_const", "const": ()}
            if spec.metavar is None
            else {"nargs": 1, "metavar": spec.metavar}
        )
        try:
            line.add_argument(flag, dest=flag, help=spec.summary, **value)
        except ArgumentError:
            source = registry.find("run_option", name).source
            log(f"star: {flag} of {source} is left out: star run has an option of that name itself")


def run(options: Namespace, registry: Registry) -> int:
    """Fly the mission, print its summary and return the exit status."""
    answer, operator = sys.stdout, Operator()
    with Progress("loading plugins"):
        from star_basics.flight import log_to_stderr, run_mission

    log_to_stderr(verbose=options.verbose)
    # What plugins print must not be in the JSON.
    with redirect_stdout(sys.stderr) if options.json else nullcontext():
        status, text = run_mission(
            options.mission,
            assignments(options),
            registry,
            out=options.out,
            keep=not options.no_record,
            save_frames=options.save_frames,
            observers={
                key.removeprefix("--"): values
                for key, values in vars(options).items()
                if key.startswith("--") and values is not None
            },
            as_json=options.json,
            operator=operator,
        )
        if answer.isatty() and on_terminal() and not (os.environ.get("NO_COLOR") or options.json):
            head, end, rest = printable(text).partition("\n")
            text, answer = f"{RED if status else GREEN}{head}{PLAIN}{end}{rest}", unescaped(answer)
        print(text, file=answer, flush=True)
        with suppress(KeyboardInterrupt):
            operator.await_landings()
    return status
