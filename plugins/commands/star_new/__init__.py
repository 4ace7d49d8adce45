"""Command ``star new``: writes a mission, a world or a plugin to begin with."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="new",
        summary="Write a mission, a world or a plugin to begin with.",
        configure=deferred("star_new.command:configure"),
        run=deferred("star_new.command:run"),
        group="Author",
    )
