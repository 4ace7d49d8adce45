"""Observer ``record``: writes the files of a run to its folder."""

from __future__ import annotations

from typing import TYPE_CHECKING

from star_core import hookimpl

if TYPE_CHECKING:
    from star_core import Flight, Operator
    from star_record.recorder import Recorder


@hookimpl
def star_mission_started(flight: Flight, operator: Operator) -> Recorder | None:
    if flight.folder is None:
        return None
    from star_record.recorder import Recorder

    return Recorder(flight, flight.folder, operator.lost)
