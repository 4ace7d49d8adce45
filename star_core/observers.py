"""Calls the observers of a flight; one that raises is dropped."""

from __future__ import annotations

import json
import logging
from collections.abc import Collection, Iterable, Mapping
from functools import partial
from typing import Any

from star_core.discovery import Source
from star_core.errors import ContractError
from star_core.messages.events import Event, Flight
from star_core.operator import Operator
from star_core.plugin_support.compute_time import ComputeTime
from star_core.plugin_support.guard import DroppingGuard
from star_core.plugin_support.plugin_manager import PluginManager

log = logging.getLogger(__name__)


class Observers:
    """Calls the observing hooks, so that no plugin can ground a flight.

    Args:
        plugins: Those that observe flights, by name.

    Attributes:
        events: All events so far.
    """

    def __init__(self, plugins: Mapping[str, object], compute_time: ComputeTime) -> None:
        self._manager = PluginManager(self._guard, self._checked)
        for name, plugin in plugins.items():
            self._manager.register(plugin, name)
        self._compute_time = compute_time
        self.events: list[Event] = []
        self._time = 0.0
        self._guards: dict[tuple[str, str], DroppingGuard] = {}
        self._of_flight: dict[str, object] = {}
        self._used: list[object] = []  # results of hooks
        self._measures: dict[str, Any] = {}
        self._taken: frozenset[str] = frozenset()  # keys of the summary

    def start(self, flight: Flight, operator: Operator) -> None:
        """Begin a flight; what a plugin returns then observes this flight in its place."""
        self.notify("star_mission_started", flight=flight, operator=operator)
        plugins = self._manager.plugins
        self._manager = PluginManager(self._guard, self._checked)
        for name, plugin in plugins.items():
            with self._guard(name, "star_mission_started"):
                self._manager.register(self._of_flight.get(name, plugin), name)
        for name, text in [*self._manager.unknown_hooks()]:
            if name in self._of_flight:  # the registry has checked the others
                with self._guard(name, "star_mission_started"):
                    raise ContractError(text)

    def begin_tick(self, time: float) -> None:
        """Set the mission time of the events that follow, s."""
        self._time = time

    def notify(self, hook: str, /, **arguments: Any) -> None:
        """Call every implementation of a hook; drop the plugin of one that raises."""
        getattr(self._manager.hook, hook)(**arguments)

    def measures(self, taken: Collection[str]) -> dict[str, Any]:
        """Return what the observers measured, by keys of the summary.

        Args:
            taken: Keys that are in the summary already.
        """
        self._taken = frozenset(taken)
        self.notify("star_summary")
        return self._measures

    def event(
        self,
        kind: str,
        text: str,
        agent: str | None = None,
        details: Mapping[str, Any] | None = None,
    ) -> None:
        """Record an `Event` at the current mission time and report it to the observers."""
        self.record(Event(self._time, kind, " ".join(text.splitlines()), agent, details))

    def record(self, event: Event) -> None:
        """Record an event and report it to the observers."""
        self.events.append(event)
        self.notify("star_event", event=event)

    def _checked(self, plugin: str, hook: str, result: Any) -> Any:
        """Use the result of a hook: an observer of this flight only, or what one measured."""
        if any(result is used for used in self._used):  # a wrapper returns it
            return result
        if hook == "star_mission_started":
            self._used.append(result)
            self._of_flight[plugin] = result
        elif hook == "star_summary":
            self._used.append(result)
            self._measures |= _measures(result, {*self._taken, *self._measures})
        return result

    def _guard(self, plugin: str, hook: str) -> DroppingGuard:
        guard = self._guards.get((plugin, hook))
        if guard is None:
            watch = None
            if hook != "star_mission_started":  # it may wait, as for a browser
                watch = self._compute_time.of(f"observer {plugin}", quiet=Source(plugin).own)
            guard = self._guards[plugin, hook] = DroppingGuard(
                partial(self._drop, plugin, hook), watch
            )
        return guard

    def _drop(self, plugin: str, hook: str, error: BaseException) -> None:
        log.debug("observer %s raised", plugin, exc_info=error)
        why = " ".join(f"{hook} raised {type(error).__name__}: {error}".split())  # on one line
        log.warning("observer %s is dropped for this flight: %s", plugin, why)
        self._manager.remove(plugin)
        self.event("observer", f"{plugin} is dropped: {why}")


def _measures(measures: Mapping[str, Any], taken: Iterable[str]) -> dict[str, Any]:
    """Return what a plugin measured, as JSON: as `summary.json` has it.

    Args:
        measures: By the keys of the summary.
        taken: Keys that the core has, or that other plugins contributed.

    Raises:
        ContractError: A key is taken, or a value is not JSON.
    """
    measured: dict[str, Any] = {}
    for key, value in dict(measures).items():
        if key in taken:
            raise ContractError(f"the summary has a key {key!r} already")
        try:
            measured |= json.loads(json.dumps({key: value}, allow_nan=False))
        except (TypeError, ValueError, RecursionError) as error:
            raise ContractError(f"{key} is not JSON: {error}") from error
    return measured
