"""Command ``star calibrate``: finds out what a camera's lens does from pictures of a board."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import Offer, hookimpl


@hookimpl
def star_commands() -> Iterator[Offer[int]]:
    yield Offer(
        name="calibrate",
        summary="Calibrate a camera by pictures of a printed chessboard.",
        make=_calibrate,
    )


def _calibrate(arguments: Sequence[str]) -> int:
    from star_calibrate.command import main

    return main(arguments)
