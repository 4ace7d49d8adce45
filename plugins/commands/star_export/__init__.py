"""Command ``star export``: writes a recorded flight in other formats."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import CommandSpec, hookimpl


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="export",
        summary="Write a recorded flight as CSV, or as TUM trajectories for evo.",
        make=_export,
        group="Review",
    )


def _export(arguments: Sequence[str]) -> int:
    from star_export.command import main

    return main(arguments)
