"""Command ``star export``: writes a recorded flight in other formats."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="export",
        summary="Write a recorded flight as CSV, or as TUM trajectories for evo.",
        configure=deferred("star_export.command:configure"),
        run=deferred("star_export.command:run"),
        group="Review",
    )
