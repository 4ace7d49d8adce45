"""Command ``star bench``: flies avoiders through seeded scenarios, and tabulates how they did."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import Offer, hookimpl


@hookimpl
def star_commands() -> Iterator[Offer[int]]:
    yield Offer(
        name="bench",
        summary="Fly avoiders x scenarios x numbers of agents x seeds, and tabulate how they did.",
        make=_bench,
    )


def _bench(arguments: Sequence[str]) -> int:
    from star_bench.command import main

    return main(arguments)
