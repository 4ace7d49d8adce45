"""Command ``star tags``: prints the tags of a world in true size."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="tags",
        summary="Write the tags of a world as sheets to print in true size (PDF or SVG).",
        configure=deferred("star_tags.command:configure"),
        run=deferred("star_tags.command:run"),
        group="Hardware",
    )
