"""Command lines of benchmarks, and their figures on standard output."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any


def command_line(description: str | None, **numbers: float) -> argparse.ArgumentParser:
    """Return a parser of ``--json``, and of an option for each number with its default."""
    line = argparse.ArgumentParser(description=description)
    line.add_argument("--json", action="store_true", help="print one JSON object, only")
    for name, default in numbers.items():
        line.add_argument(f"--{name}", type=type(default), default=default, help="%(default)s")
    return line


def show(
    figures: Mapping[str, Any], *, as_json: bool, goals: Mapping[str, float] = MappingProxyType({})
) -> None:
    """Print figures as one JSON object, or as a table with the goals of some of them."""
    if as_json:
        print(json.dumps(figures))
        return
    for name, value in figures.items():
        goal = f"   (goal: at most {goals[name]:g})" if name in goals else ""
        print(f"{name:48}{value:12.4g}{goal}")
