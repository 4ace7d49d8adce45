"""Shows a flight in progress: a live table on a terminal, plain lines in a pipe."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

from star_core.hookspecs import hookimpl
from star_core.messages.events import Event, Flight, Tick
from star_core.messages.state import AgentPhase

REFRESH_PERIOD = 0.1  # s of wall time
MAX_ROWS = 20  # agents in the table


class _Console(Console):
    """Raises when the reader of the pipe has exited, instead of ending the process."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


class Progress:
    """An observer that writes to standard error.

    Args:
        console: For the output.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or _Console(stderr=True)
        self._live: Live | None = None
        self._names: tuple[str, ...] = ()
        self._title = ""
        self._shown = 0.0

    @hookimpl
    def star_mission_started(self, flight: Flight) -> None:
        self._names = flight.scene.names
        self._title = flight.mission
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False, transient=True)
            self._live.start()

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        now = time.monotonic()
        if self._live is not None and now - self._shown > REFRESH_PERIOD:
            self._shown = now
            self._live.update(self._table(tick), refresh=True)

    @hookimpl
    def star_event(self, event: Event) -> None:
        line = f"{event.time:8.2f} s  {event.text}"
        self._console.print(line, markup=False, emoji=False, highlight=False, soft_wrap=True)

    @hookimpl
    def star_mission_ended(self, summary: Mapping[str, Any]) -> None:
        if self._live is not None:
            self._live.stop()

    def _table(self, tick: Tick) -> Table:
        table = Table(title=f"{self._title}  {tick.time:.1f} s  {tick.doing}", title_justify="left")
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
