"""Command ``star calibrate``: calibrates a camera by images of a chessboard."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import CommandSpec, hookimpl


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="calibrate",
        summary="Calibrate a camera by images of a printed chessboard.",
        make=_calibrate,
        group="Hardware",
    )


def _calibrate(arguments: Sequence[str]) -> int:
    from star_calibrate.command import main

    return main(arguments)
