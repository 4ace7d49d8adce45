"""Command ``star explain``: prints a mission as a readable plan, or draws it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import CommandSpec, hookimpl


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="explain",
        summary="Print a mission as a plan with every timeout, or draw it (Mermaid).",
        make=_explain,
        group="Author",
    )


def _explain(arguments: Sequence[str]) -> int:
    from star_explain.command import main

    return main(arguments)
