"""Command ``star evaluate``: the errors of a recorded flight against ground truth from a file."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="evaluate",
        summary="Compare a recorded flight with ground truth: position errors of each agent.",
        configure=deferred("star_evaluate.command:configure"),
        run=deferred("star_evaluate.command:run"),
        group="Review",
    )
