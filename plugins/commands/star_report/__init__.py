"""Command ``star report``: shows a recorded flight or a study on one page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from star_core import CommandSpec, hookimpl


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="report",
        summary="Write a recorded flight or a study as one HTML page.",
        make=_report,
        group="Review",
    )


def _report(arguments: Sequence[str]) -> int:
    from star_report.command import main

    return main(arguments)
