"""Command ``star import``: converts files of the original STAR and Crazyswarm2 to missions."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="import",
        summary="Convert files of the original STAR or of Crazyswarm2 to a mission and its world.",
        configure=deferred("star_import.command:configure"),
        run=deferred("star_import.command:run"),
        group="Author",
    )
