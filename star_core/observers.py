"""Calls the observers of a flight; one that raises is dropped."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from star_core.messages.events import Event
from star_core.plugin_support.compute_time import ComputeTime
from star_core.plugin_support.guard import PluginTimeout
from star_core.plugin_support.plugin_manager import PluginManager

log = logging.getLogger(__name__)


class Observers:
    """Calls the observing hooks, so that no plugin can ground a flight.

    Args:
        plugins: By name; those that observe nothing too.
        compute_time: Measures each plugin.

    Attributes:
        events: All events so far.
    """

    def __init__(self, plugins: Mapping[str, object], compute_time: ComputeTime) -> None:
        self._manager = PluginManager(self._guard)
        for name, plugin in plugins.items():
            self._manager.register(plugin, name)
        self._compute_time = compute_time
        self.events: list[Event] = []
        self._time = 0.0

    def begin_tick(self, time: float) -> None:
        """Set the mission time of the events that follow, s."""
        self._time = time

    def notify(self, hook: str, /, **arguments: Any) -> None:
        """Call every implementation of a hook; drop the plugin of one that raises."""
        getattr(self._manager.hook, hook)(**arguments)

    def event(
        self,
        kind: str,
        text: str,
        agent: str | None = None,
        details: Mapping[str, Any] | None = None,
    ) -> None:
        """Record an `Event` at the current mission time and report it to the observers."""
        self.record(Event(self._time, kind, text, agent, details))

    def record(self, event: Event) -> None:
        """Record an event and report it to the observers."""
        self.events.append(event)
        self.notify("star_event", event=event)

    @contextmanager
    def _guard(self, plugin: str, hook: str) -> Iterator[None]:
        try:
            with self._compute_time.of(f"observer {plugin}"):
                yield
        except (Exception, SystemExit, PluginTimeout) as error:
            log.debug("observer %s raised", plugin, exc_info=True)
            why = f"{hook} raised {type(error).__name__}: {error}"
            log.warning("observer %s is dropped for this flight: %s", plugin, why)
            self._manager.remove(plugin)
            self.event("observer", f"{plugin} is dropped: {why}")
