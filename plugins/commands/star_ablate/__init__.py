"""Command ``star ablate``: flies a study, which is missions times levels times seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import Offer, hookimpl


@hookimpl
def star_commands() -> Iterator[Offer[int]]:
    yield Offer(
        name="ablate",
        summary="Fly a study: missions x levels x seeds, and tabulate what was measured.",
        make=_ablate,
    )


def _ablate(arguments: Sequence[str]) -> int:
    from star_ablate.command import main

    return main(arguments)
