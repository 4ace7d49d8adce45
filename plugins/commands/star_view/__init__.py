"""Command ``star view`` and option ``star run --view``: show flights in the browser."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from importlib.util import find_spec

from star_core import InputError, Mission, Registry, hookimpl
from star_core.commands import CommandSpec, RunOptionSpec
from star_core.toolkit import Progress


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="view",
        summary="Show a mission or a recorded flight in 3-D in the browser.",
        make=_view,
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


def _view(arguments: Sequence[str]) -> int:
    with Progress("loading star view"):
        from star_view.command import main

    return main(arguments)


def _watch(mission: Mission, registry: Registry) -> object:
    require_viser("star run --view")
    from star_view.avoidance import radius
    from star_view.live_view import LiveView

    plugin = mission.parts["avoider"]
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
