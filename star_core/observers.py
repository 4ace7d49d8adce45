"""Calls the observers of a flight; one that raises is dropped."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import pluggy

from star_core.messages.events import Event
from star_core.plugin_support.guard import PluginTimeout
from star_core.plugin_support.hook_calls import PluginCall, plugin_calls
from star_core.plugin_support.timing import ComputeTime, Stopwatch

log = logging.getLogger(__name__)

HOOKS = (
    "star_mission_started",
    "star_ticked",
    "star_phase_changed",
    "star_event",
    "star_mission_ended",
)


class Observers:
    """Calls the observing hooks one plugin at a time, so that none can ground a flight.

    Args:
        manager: Holds the plugins.
        compute_time: Measures each plugin.

    Attributes:
        events: All events so far.
    """

    def __init__(self, manager: pluggy.PluginManager, compute_time: ComputeTime) -> None:
        self._calls = {hook: plugin_calls(manager, hook) for hook in HOOKS}
        self._dropped: set[str] = set()
        self._compute_time = compute_time
        self.events: list[Event] = []
        self._time = 0.0

    def begin_tick(self, time: float) -> None:
        """Set the mission time of the events that follow, s."""
        self._time = time

    def notify(self, hook: str, /, **arguments: Any) -> None:
        """Call every implementation of a hook; drop the plugin of one that raises."""
        self._notify(hook, arguments, self._calls[hook])

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

    def _notify(self, hook: str, arguments: Mapping[str, Any], calls: Sequence[PluginCall]) -> None:
        for i, call in enumerate(calls):
            if call.plugin in self._dropped:
                continue  # also if it was dropped during this call
            if call.wraps:
                self._wrap(hook, arguments, call, calls[i + 1 :])
                return
            with self._guard(hook, call):
                call.caller(**arguments)

    def _wrap(
        self, hook: str, arguments: Mapping[str, Any], call: PluginCall, inner: Sequence[PluginCall]
    ) -> None:
        """Call a plugin's wrapper around the calls of the plugins after it.

        Their time is not counted as the wrapper's; they are called also where it raises first.
        """
        called = False
        watch = self._watch(call)

        def call_inner() -> None:
            nonlocal called
            called = True
            watch.__exit__()
            try:
                self._notify(hook, arguments, inner)
            finally:
                watch.__enter__()

        with self._guard(hook, call):
            call.caller.call_extra([call_inner], arguments)
        if not called:
            self._notify(hook, arguments, inner)

    @contextmanager
    def _guard(self, hook: str, call: PluginCall) -> Iterator[None]:
        try:
            with self._watch(call):
                yield
        except (Exception, SystemExit, PluginTimeout) as error:
            log.debug("observer %s raised", call.plugin, exc_info=True)
            self._drop(call.plugin, f"{hook} raised {type(error).__name__}: {error}")

    def _watch(self, call: PluginCall) -> Stopwatch:
        return self._compute_time.of(f"observer {call.plugin}")

    def _drop(self, plugin: str, why: str) -> None:
        log.warning("observer %s is dropped for this flight: %s", plugin, why)
        self._dropped.add(plugin)
        self.event("observer", f"{plugin} is dropped: {why}")
