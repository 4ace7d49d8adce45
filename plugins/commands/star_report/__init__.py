"""Command ``star report`` and option ``star run --report``: a flight or a study on one page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec, RunOptionSpec

if TYPE_CHECKING:
    from pathlib import Path

    from star_core import Mission, Registry
    from star_core.toolkit import WrittenReport
    from star_report.observer import Reporter


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="report",
        summary="Write a recorded flight or a study as one HTML page.",
        configure=deferred("star_report.command:configure"),
        run=deferred("star_report.command:run"),
        group="Review",
    )


@hookimpl
def star_run_options() -> Iterator[RunOptionSpec]:
    yield RunOptionSpec(
        name="report",
        summary="write report.html beside the record when the flight is over",
        make=_observer,
    )


@hookimpl
def star_report(folder: Path) -> WrittenReport:
    from star_report.command import write

    return write(folder)


def _observer(_mission: Mission, _registry: Registry) -> Reporter:
    from star_report.command import require_plotly
    from star_report.observer import Reporter

    require_plotly()
    return Reporter()
