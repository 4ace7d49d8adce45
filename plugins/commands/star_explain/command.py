"""Command line of ``star explain``: reads a mission, and prints or draws its plan."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from star_core import Mission, Registry, load
from star_core.commands import add_set_option, completes, mission_names
from star_core.toolkit import Progress, Rehearsal
from star_explain.mermaid import mermaid
from star_explain.origins import Origins
from star_explain.plan import plan
from star_explain.results import Group, Part, StepResult, results, with_others
from star_explain.variants import variants
from star_explain.words import facts, own_options


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Explain a mission and return the exit status, 0.

    Raises:
        InputError: The mission cannot be flown; lists every reason.
    """
    with Progress(f"rehearsing {options.mission}"):
        mission = load(Path(options.mission), registry, options.set)
        rehearsal, result = _rehearsed(mission, registry)
        others = [_rehearsed(variant, registry)[1] for variant in [*variants(mission)][1:]]
        result = with_others(result, others)
    if options.mermaid:
        text = mermaid(mission.name, result)
    elif options.json:
        text = json.dumps({"mission": mission.name, "plan": as_data(result, rehearsal)}, indent=2)
    else:
        lines = [*facts(mission, registry), "", *plan(result, registry)]
        text = "\n".join(wrapped(lines) if sys.stdout.isatty() else lines) + "\n"
    sys.stdout.write(text)
    return 0


def _rehearsed(mission: Mission, registry: Registry) -> tuple[Rehearsal, Group]:
    rehearsal = registry.manager.hook.star_rehearse(mission=mission, registry=registry)
    origins = Origins(mission, registry, rehearsal)
    return rehearsal, results(mission, registry, rehearsal, origins)


def wrapped(lines: Iterable[str]) -> Iterator[str]:
    """Yield lines for a terminal, broken between words; what follows is indented by four more."""
    wrapper = textwrap.TextWrapper(
        shutil.get_terminal_size().columns, break_long_words=False, break_on_hyphens=False
    )
    for line in lines:
        wrapper.subsequent_indent = " " * (len(line) - len(line.lstrip()) + 4)
        yield from wrapper.wrap(line) or [""]


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Print a mission as a plan: the agents and options of every step, its duration "
        "without disturbances, its timeout, and the options left to their defaults."
    )
    completes(line.add_argument("mission", help="mission file (YAML)"), mission_names)
    add_set_option(line)
    how = line.add_mutually_exclusive_group()
    how.add_argument("--mermaid", action="store_true", help="print a Mermaid flowchart, only")
    how.add_argument("--json", action="store_true", help="print the steps as JSON, only")


def as_data(part: Part, rehearsal: Rehearsal) -> dict[str, Any]:
    """Return a step as plain data: times in s, null if unknown."""
    times = {"takes_s": part.takes, "timeout_s": part.limit}
    if isinstance(part, Group):
        how = "at_once" if part.at_once else "in_order"
        how = "either" if part.kind == "choice" else how
        return {
            "type": part.kind,
            **({"when": part.title} if part.title else {}),
            how: [as_data(inner, rehearsal) for inner in part.parts],
            "times": part.times,
            **times,
        }
    return _step(part, rehearsal, times)


def _step(
    result: StepResult, rehearsal: Rehearsal, times: dict[str, float | None]
) -> dict[str, Any]:
    action = result.action
    return {
        "type": "step",
        "verb": action.verb,
        "location": action.location,
        "agents": list(result.agents),
        "options": own_options(action),
        "until": action.written.get("until"),
        "on_failure": action.on_failure,
        "fault": result.fault,
        "paths": {
            name: rehearsal.path(step, row).round(3).tolist()
            for step in result.rounds[:1]
            for name, row in zip(result.agents, step.rows, strict=True)
        },
        **times,
    }
