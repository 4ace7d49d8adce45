"""Command ``star view``: shows a mission or a recorded flight in the browser."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import CommandSpec, hookimpl


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="view",
        summary="Show a mission or a recorded flight in 3-D in the browser.",
        make=_view,
        group="Review",
    )


def _view(arguments: Sequence[str]) -> int:
    from star_view.command import main

    return main(arguments)
