"""Command ``star tags``: prints the tags of a world in true size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import Offer, hookimpl


@hookimpl
def star_commands() -> Iterator[Offer[int]]:
    yield Offer(
        name="tags",
        summary="Write the tags of a world as sheets to print in true size (PDF or SVG).",
        make=_tags,
    )


def _tags(arguments: Sequence[str]) -> int:
    from star_tags.command import main

    return main(arguments)
