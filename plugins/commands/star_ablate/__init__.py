"""Command ``star ablate``: flies a study, which is missions times levels times seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import CommandSpec, hookimpl


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="ablate",
        summary="Fly a study (missions x levels x seeds) and tabulate its measures.",
        make=_ablate,
        group="Study",
    )


def _ablate(arguments: Sequence[str]) -> int:
    from star_ablate.command import main

    return main(arguments)
