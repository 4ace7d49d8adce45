"""Observer ``record``: writes the files of a run to its folder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from star_core import hookimpl

if TYPE_CHECKING:
    from star_core import Event, Flight, Operator, Tick
    from star_record.recorder import Recorder

_recorders: list[Recorder] = []  # of the current flight, if it is recorded


@hookimpl
def star_mission_started(flight: Flight, operator: Operator) -> None:
    _recorders.clear()
    if flight.folder is not None:
        from star_record.recorder import Recorder

        _recorders.append(Recorder(flight, flight.folder, operator.lost))


@hookimpl
def star_ticked(tick: Tick) -> None:
    for recorder in _recorders:
        recorder.add(tick)


@hookimpl
def star_event(event: Event) -> None:
    for recorder in _recorders:
        recorder.log.write(event)


@hookimpl
def star_mission_ended(summary: Mapping[str, Any]) -> None:
    for recorder in _recorders:
        recorder.close(summary)
    _recorders.clear()
