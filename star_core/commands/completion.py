"""Completion of command lines in a shell, by argcomplete: commands, options, missions, plugins."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import PurePath
from typing import TYPE_CHECKING, TypeAlias

from star_core.plugin_support.registry import Registry

if TYPE_CHECKING:
    from star_core.plugin_support.specs import CommandSpec

Completer: TypeAlias = Callable[..., Iterable[str]]
"""``completer(prefix, **context)`` returns what a word that begins so may become."""


def completes(action: argparse.Action, completer: Completer) -> None:
    """Let a completer complete the values of an argument."""
    vars(action)["completer"] = completer


def mission_names(prefix: str, **_context: object) -> list[str]:
    """Return the names of missions that come with the formats, and the files that begin so."""
    from argcomplete.completers import FilesCompleter

    formats = [spec for spec in Registry().offers()["format"].values() if spec.missions]
    names = [name for spec in formats for name in spec.missions()]
    return [*(name for name in names if name.startswith(prefix)), *FilesCompleter()(prefix)]


def complete() -> None:
    """Print what the word at the cursor may become, and exit."""
    from argcomplete import autocomplete

    autocomplete(_parser(os.environ["COMP_LINE"].split()))


def _parser(words: list[str]) -> argparse.ArgumentParser:
    """Return a parser of all commands; only those on the command line have their arguments."""
    specs: list[CommandSpec] = [p.offer for kind, p in Registry() if kind == "command"]
    _, dash, only = PurePath(sys.argv[0]).name.partition("star-")
    if dash:
        words = [*words, only]
    line = argparse.ArgumentParser(prog="star")
    line.add_argument("-V", "--version", action="store_true")
    commands = line.add_subparsers()
    for spec in specs:
        command = commands.add_parser(spec.name, help=spec.summary)
        if spec.name in words:
            spec.configure(command)
        if dash and spec.name == only:
            return command
    described = commands.add_parser("help", help="Describe a command.")
    described.add_argument("command", choices=[spec.name for spec in specs])
    return line
