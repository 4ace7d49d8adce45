"""Command line of ``star check``."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from star_basics.mission_arguments import add_mission, assignments
from star_core import Registry
from star_core.formats import check_file
from star_core.toolkit import Progress, log


def configure(line: ArgumentParser) -> None:
    """Add the options of the command."""
    add_mission(line, "; or another kind of file of `star schema`")


def run(options: Namespace, registry: Registry) -> int:
    """Check the file, print what it is good for and return the exit status, 0.

    Raises:
        InputError: Something is wrong with it.
    """
    with Progress(f"checking {options.mission}"):
        text, warnings = check_file(Path(options.mission), registry, assignments(options))
    for warning in warnings:
        log(warning)
    print(text)
    return 0
