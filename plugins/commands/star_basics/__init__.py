"""Built-in commands: run, stop, check, missions, errors, schema and plugins."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Final

from star_core import Problem, deferred, hookimpl
from star_core.commands import CommandSpec

if TYPE_CHECKING:
    from star_core import Registry


COMMANDS: Final = (  # name, module, group and summary
    ("run", "run", "Fly", "Fly a mission (= star-run)."),
    ("stop", "stop_flights", "Fly", "Land all agents of the running flights."),
    (
        "check",
        "check",
        "Author",
        "Check missions, worlds, studies and other files, without a flight.",
    ),
    ("missions", "missions", "Author", "List the missions that come with STAR."),
    ("errors", "errors", "Author", "Explain the code of an error."),
    ("schema", "schema", "Author", "Write a schema for an editor."),
    ("plugins", "list_plugins", "Plugins", "List plugins, or describe one."),
)
SHOW_PLUGINS: Final = ("run", "schema")  # in their help, and take a registry for it


@hookimpl
def star_commands(registry: Registry) -> Iterator[CommandSpec]:
    for name, module, group, summary in COMMANDS:
        configure = deferred(f"star_basics.{module}:configure")
        if name in SHOW_PLUGINS:
            configure = partial(configure, registry)
        run = deferred(f"star_basics.{module}:run")
        yield CommandSpec(name=name, summary=summary, configure=configure, run=run, group=group)


@hookimpl
def star_check(registry: Registry) -> Iterator[Problem]:
    if text := registry.missing_monitors():
        yield Problem((), text, "missing-monitors", warning=True)
