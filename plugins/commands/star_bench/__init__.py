"""Command ``star bench``: flies avoiders through seeded scenarios, and tabulates the results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import CommandSpec, hookimpl


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="bench",
        summary="Fly avoiders x scenarios x numbers of agents x seeds, and tabulate the results.",
        make=_bench,
        group="Study",
    )


def _bench(arguments: Sequence[str]) -> int:
    from star_bench.command import main

    return main(arguments)
