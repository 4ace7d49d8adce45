"""Commands of ``star``, run in this process."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from star_core import Registry
from star_core.commands import run_command


def command(name: str) -> Callable[[Sequence[str]], int]:
    """Return a function that runs a command with arguments; its errors are raised."""
    return lambda arguments: run_command(name, arguments, Registry())


def problem_lines(stderr: str) -> list[str]:
    """Return the problems that ``star check`` has printed, without excerpts and summary."""
    rest = re.compile(r" +\d* \| .*|Found \d+ .*")
    return [line for line in stderr.splitlines() if not rest.fullmatch(line)]
