"""Command ``star view`` and option ``star run --view``: show flights in the browser."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib.util import find_spec
from typing import TYPE_CHECKING

from star_core import InputError, Mission, Registry, deferred, hookimpl
from star_core.commands import CommandSpec, RunOptionSpec
from star_core.toolkit import Progress

if TYPE_CHECKING:
    import argparse


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="view",
        summary="Show a mission or a recorded flight in 3-D in the browser.",
        configure=_view,
        run=deferred("star_view.command:run"),
        group="Review",
    )


@hookimpl
def star_run_options() -> Iterator[RunOptionSpec]:
    yield RunOptionSpec(
        name="view",
        summary="show the flight in 3-D in the browser; a simulation then runs in real time, if no "
        "speed is given",
        make=_watch,
    )


def _view(line: argparse.ArgumentParser) -> None:
    with Progress("loading star view"):
        from star_view.command import configure

    configure(line)


def _watch(mission: Mission, registry: Registry) -> object:
    require_viser("star run --view")
    from star_view.avoidance import radius
    from star_view.live_view import LiveView

    plugin = mission.plugins["avoider"]
    kept_free = radius(plugin.use, plugin.options, registry)
    return LiveView(kept_free, wait_for_browser=sys.stderr.isatty())


def require_viser(command: str) -> None:
    """Check that viser is installed.

    Raises:
        InputError: It is not.
    """
    if find_spec("viser") is None:
        text = f"{command} needs viser: pip install 'star-swarm[view]'"
        raise InputError(text, "missing-package")
