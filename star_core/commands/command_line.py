"""Parses the command line of a command, and runs it."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from star_core.errors import InputError, PluginError, suggestion
from star_core.plugin_support.guard import PluginGuard

if TYPE_CHECKING:
    from star_core.plugin_support.specs import CommandSpec
    from star_core.registry import Found, Registry


def run_command(name: str, arguments: Sequence[str], registry: Registry) -> int:
    """Run a command and return its exit status.

    Raises:
        StarError: There is none of that name, or its arguments are invalid.
        SystemExit: By argparse, for an invalid value and for ``--help``.
    """
    found = registry.find("command", name)
    options = guarded("command", found, parse, found.offer, arguments)
    status: int = guarded("command", found, found.offer.run, options, registry)
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
        known = re.findall("--[a-z-]+", line.format_help())
        hint = suggestion(unknown[0], known, "there are")
        raise InputError(f"unknown option {unknown[0]!r}{hint}", "unknown-option")
    return options


def guarded(kind: str, found: Found, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return the result of a function of a plugin.

    Raises:
        PluginError: A third party's raised neither `InputError` nor `SystemExit`.
    """
    if found.source.own:  # its other errors are bugs, and show their tracebacks
        return function(*arguments)
    try:
        with PluginGuard(f"{kind} {found.offer.name!r} ({found.source})"):
            return function(*arguments)
    except PluginError as error:
        if isinstance(error.__cause__, SystemExit | InputError | BrokenPipeError):
            raise error.__cause__ from None
        raise
