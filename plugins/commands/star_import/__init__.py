"""Command ``star import``: turns the original STAR's and Crazyswarm2's files into missions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import Offer, hookimpl


@hookimpl
def star_commands() -> Iterator[Offer[int]]:
    yield Offer(
        name="import",
        summary="Turn files of the original STAR or of Crazyswarm2 into a mission and its world.",
        make=_import,
    )


def _import(arguments: Sequence[str]) -> int:
    from star_import.command import main

    return main(arguments)
