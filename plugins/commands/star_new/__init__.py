"""Command ``star new``: writes a mission, a world or a plugin to begin with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import CommandSpec, hookimpl


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="new",
        summary="Write a mission, a world or a plugin to begin with.",
        make=_new,
        group="Author",
    )


def _new(arguments: Sequence[str]) -> int:
    from star_new.command import main

    return main(arguments)
