"""Command ``star import``: converts files of the original STAR and Crazyswarm2 to missions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import CommandSpec, hookimpl


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="import",
        summary="Convert files of the original STAR or of Crazyswarm2 to a mission and its world.",
        make=_import,
        group="Author",
    )


def _import(arguments: Sequence[str]) -> int:
    from star_import.command import main

    return main(arguments)
