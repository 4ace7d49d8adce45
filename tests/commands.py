"""Commands of ``star``, run in this process."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import TypeAlias

import pytest

from star_core import Registry
from star_core.commands import run_command

Printed: TypeAlias = pytest.CaptureFixture[str]
"""The fixture ``capsys``: what a command prints."""


def command(name: str) -> Callable[[Sequence[str]], int]:
    """Return a function that runs a command with arguments; its errors are raised."""
    return lambda arguments: run_command(name, arguments, Registry())


def position_and_code(problem: str) -> str:
    """Return where a problem is, and its code, whatever its words.

    >>> position_and_code("m.yaml:6:35: no camera named 'xyz' [unknown-camera]")
    'm.yaml:6:35 [unknown-camera]'
    """
    match = re.fullmatch(r"([^:]+:\d+:\d+): .*(\[[a-z-]+\])\n?", problem, re.DOTALL)
    assert match is not None, problem
    return f"{match[1]} {match[2]}"


def problem_lines(stderr: str) -> list[str]:
    """Return the problems that ``star check`` has printed, and nothing else of its output."""
    rest = re.compile(r" +\d* \| .*|Found \d+ .*|compiling kernels .*")
    return [line for line in stderr.splitlines() if not rest.fullmatch(line)]
