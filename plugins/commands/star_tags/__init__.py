"""Command ``star tags``: prints the tags of a world in true size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import CommandSpec, hookimpl


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="tags",
        summary="Write the tags of a world as sheets to print in true size (PDF or SVG).",
        make=_tags,
        group="Hardware",
    )


def _tags(arguments: Sequence[str]) -> int:
    from star_tags.command import main

    return main(arguments)
