"""Command ``star explain``: prints a mission as a plan that one can read, or draws it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import Offer, hookimpl


@hookimpl
def star_commands() -> Iterator[Offer[int]]:
    yield Offer(
        name="explain",
        summary="Print a mission as a plan with every time-out, or draw it (Mermaid).",
        make=_explain,
    )


def _explain(arguments: Sequence[str]) -> int:
    from star_explain.command import main

    return main(arguments)
