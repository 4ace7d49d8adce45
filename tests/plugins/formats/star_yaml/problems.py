"""What is wrong with a mission in the working folder, whatever its words: the corpus has those."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from star_core import InputError, Registry, load
from tests.commands import position_and_code


def problems(text: str, registry: Registry | None = None) -> list[str]:
    """Return ``line:column [code]`` of every problem of a mission; none if it can be flown."""
    Path("m.yaml").write_text(text)
    try:
        load("m.yaml", registry or Registry())
    except InputError as error:
        return [position_and_code(problem).removeprefix("m.yaml:") for problem in error.problems]
    return []


def of_steps(head: str, steps: Sequence[str]) -> list[str]:
    """Return the problems of a mission with these steps, each on its line: ``step 1:5 [code]``."""
    before = head.count("\n")
    found = []
    for problem in problems(head + "".join(f"  - {step}\n" for step in steps)):
        line, _, rest = problem.partition(":")
        within = int(line) - before
        found.append(f"step {within}:{rest}" if within > 0 else problem)
    return found
