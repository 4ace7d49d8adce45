"""Built-in commands: run, stop, check, missions, errors, schema and plugins."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

from star_core import Problem, deferred, hookimpl
from star_core.commands import CommandSpec

if TYPE_CHECKING:
    from star_core import Registry


@hookimpl
def star_commands(registry: Registry) -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="run",
        summary="Fly a mission (= star-run).",
        configure=partial(deferred("star_basics.run:configure"), registry),
        run=deferred("star_basics.run:run"),
        group="Fly",
    )
    yield CommandSpec(
        name="stop",
        summary="Land all agents of the running flights.",
        configure=deferred("star_basics.stop_flights:configure"),
        run=deferred("star_basics.stop_flights:run"),
        group="Fly",
    )
    yield CommandSpec(
        name="check",
        summary="Check missions, worlds, studies and other files, without a flight.",
        configure=deferred("star_basics.check:configure"),
        run=deferred("star_basics.check:run"),
        group="Author",
    )
    yield CommandSpec(
        name="missions",
        summary="List the missions that come with STAR.",
        configure=lambda _line: None,
        run=deferred("star_basics.missions:run"),
        group="Author",
    )
    yield CommandSpec(
        name="errors",
        summary="Explain the code of an error.",
        configure=deferred("star_basics.errors:configure"),
        run=deferred("star_basics.errors:run"),
        group="Author",
    )
    yield CommandSpec(
        name="schema",
        summary="Write a schema for an editor.",
        configure=partial(deferred("star_basics.schema:configure"), registry),
        run=deferred("star_basics.schema:run"),
        group="Author",
    )
    yield CommandSpec(
        name="plugins",
        summary="List plugins, or describe one.",
        configure=deferred("star_basics.list_plugins:configure"),
        run=deferred("star_basics.list_plugins:run"),
        group="Plugins",
    )


@hookimpl
def star_check(registry: Registry) -> Iterator[Problem]:
    if text := registry.missing_monitors():
        yield Problem((), text, "missing-monitors", warning=True)
