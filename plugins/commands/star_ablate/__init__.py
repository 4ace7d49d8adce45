"""Command ``star ablate``: flies a study, which is missions times levels times seeds."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="ablate",
        summary="Fly a study (missions x levels x seeds) and tabulate its measures.",
        configure=deferred("star_ablate.command:configure"),
        run=deferred("star_ablate.command:run"),
        group="Study",
    )
