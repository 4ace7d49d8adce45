"""The summary of a flight: what the core reports, and what plugins measure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from star_core.geometry.neighbours import Pairs
from star_core.messages.arrays import some
from star_core.messages.events import Corrected, Event, Tick
from star_core.safety.contacts import Contacts
from star_core.world.scene import Scene

REPORT_INTERVAL: Final = 1.0  # s without a correction, after which the next one is reported again

CORRECTIONS: Final = {
    "fence": "is held inside the fence",
    "speed": "is slowed to the speed limit",
    "separation": "brakes for another agent",
    "obstacle": "brakes early for an obstacle or the fence, since its position is uncertain",
}
"""Texts of events about agents whose setpoints the safety filter corrects, by the reason."""


class FlightSummary:
    """Follows a flight for its summary: duration, contacts and corrected setpoints.

    Args:
        scene: The agents.

    Attributes:
        contacts: Collisions and closest approaches so far.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.contacts = Contacts(scene)
        self._begun: float | None = None  # s
        self._time = 0.0  # s
        self._ticks = 0
        self._corrected = dict.fromkeys(CORRECTIONS, 0)
        self._corrected_at = {why: np.full(len(scene.agents), -np.inf) for why in CORRECTIONS}  # s

    def add(self, tick: Tick, near: Pairs) -> list[Event]:
        """Add a tick; return the events to report.

        Args:
            tick: Of the flight.
            near: Pairs of agents within ``contacts.reach``, at least, by estimated positions.
        """
        self._ticks += 1
        self._begun = tick.time if self._begun is None else self._begun
        self._time = tick.time
        if tick.truth is not None:
            near = Pairs.of(tick.truth.position, self.contacts.reach)
        return self._corrections(tick.time, tick.corrected) + self.contacts.update(tick, near)

    def _corrections(self, time: float, corrected: Corrected) -> list[Event]:
        """Count corrected setpoints; return an event for each agent when they begin."""
        events = []
        for reason, text in CORRECTIONS.items():
            rows = getattr(corrected, reason)
            if not some(rows):
                continue
            self._corrected[reason] += int(rows.sum())
            since = time - self._corrected_at[reason]
            self._corrected_at[reason][rows] = time
            for row in np.flatnonzero(rows & (since > REPORT_INTERVAL)).tolist():
                name = self._scene.agents[row].name
                events.append(Event(time, "corrected", f"{name} {text}", name))
        return events

    def summary(
        self,
        *,
        mission: str,
        outcome: str,
        reason: str,
        wall_time: float,
        took: Mapping[str, float],
    ) -> dict[str, Any]:
        """Return the core's figures in ``summary.json``; unknown ones are None.

        Args:
            mission: Its name.
            outcome: Of the mission.
            reason: Why it did not complete.
            wall_time: Duration in wall time, s.
            took: Computing time of each kind of plugin, s.
        """
        names = self._scene.names
        flight_time = self._time - (self._begun or 0.0)
        return {
            "outcome": outcome,
            "reason": reason,
            "mission": mission,
            "seed": self._scene.seed,
            "agents": list(names),
            "flight_time_s": round(flight_time, 9),
            "wall_time_s": round(wall_time, 6),
            "realtime_factor": round(flight_time / wall_time, 3) if wall_time > 0 else None,
            "compute_us": {
                kind: round(1e6 * seconds / (max(1, self._ticks) * len(names)), 3)
                for kind, seconds in took.items()
            },
            "collisions": {
                "agent_agent": self.contacts.agent_agent,
                "agent_obstacle": self.contacts.agent_obstacle,
            },
            "distances_from": self.contacts.source,
            "corrected": dict(self._corrected),
            "min_separation_m": _finite_or_none(self.contacts.separation),
            "min_clearance_m": _finite_or_none(self.contacts.clearance),
        }


def event_record(event: Event) -> dict[str, Any]:
    """Return an event as JSON has it, without what it lacks."""
    return {key: value for key, value in asdict(event).items() if value is not None}


def _finite_or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
