"""Shows a flight in progress: events, and how far it is; on a terminal a table of the agents."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

from star_core import AgentPhase, Event, Flight, Operator, Tick, hookimpl
from star_core.toolkit import Progress, log, on_terminal

if TYPE_CHECKING:
    from rich.console import RenderableType

MAX_ROWS: Final = 20  # agents in the table
ESTIMATE_AFTER: Final = 2.0  # s of wall time; a shorter flight needs no estimate of its duration


class FlightProgress:
    """An observer that reports a flight on stderr.

    Args:
        estimate: Returns the expected mission time of the flight, s; None if it is not known.
        events: Whether to report events.
    """

    def __init__(self, estimate: Callable[[], float | None], *, events: bool = True) -> None:
        self._estimate = estimate
        self._events = events
        self._names: tuple[str, ...] = ()
        self._tick: Tick | None = None
        self._progress = Progress("")
        self._estimate_at = 0.0  # s of wall time

    @hookimpl
    def star_mission_started(self, flight: Flight, operator: Operator) -> None:
        self._names, self._tick = flight.scene.names, None
        self._progress = Progress(
            flight.mission, unit="s", estimated=True, detail=self._speed, view=self._table
        )
        self._estimate_at = time.monotonic() + ESTIMATE_AFTER
        paced = operator.simulation is not None and operator.simulation.speed is not None
        if flight.scene.realtime or paced or on_terminal():  # in flight it would delay ticks
            self._progress.total = self._estimate()
        self._progress.done = 0.0
        self._progress.__enter__()

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self._tick, self._progress.done = tick, tick.time
        if self._progress.total is None and time.monotonic() >= self._estimate_at:
            self._estimate_at = float("inf")
            self._progress.total = self._estimate()

    @hookimpl
    def star_event(self, event: Event) -> None:
        if self._events and event.kind != "observer":  # which is a warning already
            log(str(event))

    @hookimpl
    def star_mission_ended(self, summary: Mapping[str, Any]) -> None:
        self._progress.__exit__()

    def _speed(self) -> str:
        factor = self._progress.done / (time.monotonic() - self._progress.begun)
        return f"{factor:.1f} times real time"

    def _table(self) -> RenderableType:
        from rich.table import Table

        tick = self._tick
        if tick is None:
            return ""
        table = Table(title=f"{tick.time:.1f} s  {tick.doing}", title_justify="left")
        for heading in ("agent", "phase", "x m", "y m", "z m", "battery V"):
            table.add_column(heading, justify="left" if heading == "agent" else "right")
        if len(self._names) > MAX_ROWS:
            table.caption = f"and {len(self._names) - MAX_ROWS} more"
        for row, name in enumerate(self._names[:MAX_ROWS]):
            x, y, z = tick.estimate.position[row]
            phase = AgentPhase(tick.health.phase[row]).name.lower().replace("_", " ")
            battery = f"{tick.health.battery[row]:.2f}"
            table.add_row(name, phase, f"{x:.2f}", f"{y:.2f}", f"{z:.2f}", battery)
        return table
