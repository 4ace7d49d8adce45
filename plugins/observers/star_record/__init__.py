"""Observer ``record``: writes the files of a run to its folder, and reads them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from star_core import hookimpl

if TYPE_CHECKING:
    from pathlib import Path

    from star_core import Flight, Operator, Registry, Run
    from star_record.recorder import Recorder


@hookimpl
def star_mission_started(flight: Flight, operator: Operator) -> Recorder | None:
    if flight.folder is None:
        return None
    from star_record.recorder import Recorder

    return Recorder(flight, flight.folder, operator.lost)


@hookimpl
def star_read_run(folder: Path, registry: Registry) -> Run:
    from star_core.formats import format_function
    from star_record.read_record import read_record

    return read_record(folder, format_function("restore", registry))
