"""The observer of ``star run --report``."""

from __future__ import annotations

import sys
from pathlib import Path

from star_core import Flight, hookimpl
from star_report.command import write


class Reporter:
    """Writes the report of a flight after its record."""

    def __init__(self) -> None:
        self._folder: Path | None = None

    @hookimpl
    def star_mission_started(self, flight: Flight) -> None:
        self._folder = flight.folder
        if flight.folder is None:
            sys.stderr.write("star: --report: no report without a record\n")

    @hookimpl(trylast=True)
    def star_mission_ended(self) -> None:
        if self._folder is not None:
            sys.stderr.write(f"report: {write(self._folder).page}\n")
