"""Parses the command line of a command, and runs it."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from star_core.errors import InputError, suggestion
from star_core.plugin_support.registry import guarded

if TYPE_CHECKING:
    from star_core.plugin_support.registry import Registry
    from star_core.plugin_support.specs import CommandSpec


def run_command(name: str, arguments: Sequence[str], registry: Registry) -> int:
    """Run a command and return its exit status.

    Raises:
        StarError: There is none of that name, or its arguments are invalid.
        SystemExit: By argparse, for an invalid value and for ``--help``.
    """
    command = registry.find("command", name)
    options = guarded("command", command, parse, command.offer, arguments)
    status: int = guarded("command", command, command.offer.run, options, registry)
    return status


def parser_of(spec: CommandSpec) -> argparse.ArgumentParser:
    """Return the parser of a command line."""
    line = argparse.ArgumentParser(
        prog=f"star {spec.name}", description=spec.summary, allow_abbrev=False
    )
    spec.configure(line)
    return line


def parse(spec: CommandSpec, arguments: Sequence[str]) -> argparse.Namespace:
    """Return the options of a command.

    Raises:
        InputError: There is a word that the command does not take.
    """
    line = parser_of(spec)
    try:
        options, unknown = line.parse_known_intermixed_args(arguments)
    except TypeError:  # it has subcommands
        options, unknown = line.parse_known_args(arguments)
    if unknown and not unknown[0].startswith("-"):
        raise InputError(f"{unknown[0]!r} is one argument too many", "invalid-argument")
    if unknown:
        flags = dict.fromkeys(re.findall("--[a-z-]+", line.format_help()))
        hint = suggestion(unknown[0], flags, "there are")
        raise InputError(f"unknown option {unknown[0]!r}{hint}", "unknown-option")
    return options
