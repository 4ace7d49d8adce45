"""Command ``star bench``: flies avoiders through seeded scenarios, and tabulates the results."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="bench",
        summary="Fly avoiders x scenarios x numbers of agents x seeds, and tabulate the results.",
        configure=deferred("star_bench.command:configure"),
        run=deferred("star_bench.command:run"),
        group="Study",
    )
