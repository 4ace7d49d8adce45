"""Tells observers what happens, and drops the one that raises."""

from __future__ import annotations

import logging
from typing import Any

import pluggy

from star_core.flight import Event

log = logging.getLogger(__name__)

WATCHING = (
    "star_mission_started",
    "star_ticked",
    "star_phase_changed",
    "star_event",
    "star_mission_ended",
)


class Observers:
    """Calls the watching hooks one implementation at a time, so that none can ground a flight.

    Args:
        manager: Holds the plugins.

    Attributes:
        events: Everything told by `event`.
        time: Mission time, s, as the pilot sets it.
    """

    def __init__(self, manager: pluggy.PluginManager) -> None:
        self._watching = {
            hook: list(reversed(getattr(manager.hook, hook).get_hookimpls())) for hook in WATCHING
        }
        self.events: list[Event] = []
        self.time = 0.0

    def tell(self, hook: str, /, **news: Any) -> None:
        """Call every implementation of a hook; one that raises is named and never called again."""
        for impl in list(self._watching[hook]):
            if impl not in self._watching[hook]:
                continue  # dropped for what it did with news of another's drop
            try:
                impl.function(*(news[name] for name in impl.argnames))
            except (Exception, SystemExit) as error:
                log.debug("observer %s raised", impl.plugin_name, exc_info=True)
                self._drop(impl.plugin_name, f"{hook} raised {type(error).__name__}: {error}")

    def event(self, kind: str, text: str, agent: str | None = None) -> None:
        """Keep an `Event` of now and tell of it."""
        self.events.append(Event(self.time, kind, text, agent))
        self.tell("star_event", event=self.events[-1])

    def _drop(self, plugin: str, why: str) -> None:
        log.warning("observer %s is dropped for this flight: %s", plugin, why)
        for hook, impls in self._watching.items():
            self._watching[hook] = [impl for impl in impls if impl.plugin_name != plugin]
        self.event("observer", f"{plugin} is dropped: {why}")
