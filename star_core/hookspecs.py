"""Every hook there is: the first six offer parts, the last five watch a mission fly.

Offering hooks are called once, before the mission is read, so they must be cheap: import what is
heavy inside ``make``. Watching hooks are called in the tick: return in well under a
period. An observer that raises is named in the log and dropped for the rest of the flight.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from star_core.contracts import (
        AvoiderSpec,
        CommandSpec,
        LocalizerSpec,
        PlannerSpec,
        TaskSpec,
        TransportSpec,
    )
    from star_core.messages.events import Event, Flight, Tick

PROJECT = "star"

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@hookspec
def star_transports() -> Iterable[TransportSpec]:  # type: ignore[empty-body]
    """Offer transports: links to a swarm, real or simulated.

    Example:
        >>> from star_core import TransportSpec, hookimpl
        >>> @hookimpl
        ... def star_transports():
        ...     yield TransportSpec(name="mine", summary="My own link.", make=object)
    """


@hookspec
def star_localizers() -> Iterable[LocalizerSpec]:  # type: ignore[empty-body]
    """Offer localizers: where the agents are, from what they report."""


@hookspec
def star_planners() -> Iterable[PlannerSpec]:  # type: ignore[empty-body]
    """Offer planners: what to fly towards the goals, each agent as if alone."""


@hookspec
def star_avoiders() -> Iterable[AvoiderSpec]:  # type: ignore[empty-body]
    """Offer avoiders: what is safe to fly instead."""


@hookspec
def star_tasks() -> Iterable[TaskSpec]:  # type: ignore[empty-body]
    """Offer tasks: verbs of the mission language, each under its own name."""


@hookspec
def star_commands() -> Iterable[CommandSpec]:  # type: ignore[empty-body]
    """Offer further ``star`` commands.

    ``make(arguments)`` runs one with the rest of the command line and returns its exit status.
    """


@hookspec
def star_mission_started(flight: Flight) -> None:
    """The links are open and nothing has moved yet."""


@hookspec
def star_ticked(tick: Tick) -> None:
    """One tick is over."""


@hookspec
def star_phase_changed(time: float, agent: str | None, phase: str) -> None:
    """An agent, or with None the mission, went into another phase."""


@hookspec
def star_event(event: Event) -> None:
    """Something happened that belongs in the record."""


@hookspec
def star_mission_ended(summary: Mapping[str, Any]) -> None:
    """The flight is over, the links are closed; ``reason`` names agents that did not land."""
