"""Command ``star calibrate``: prints a chessboard, and calibrates a camera by images of it."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="calibrate",
        summary="Calibrate a camera by images of a chessboard, or print the board.",
        configure=deferred("star_calibrate.command:configure"),
        run=deferred("star_calibrate.command:run"),
        group="Hardware",
    )
