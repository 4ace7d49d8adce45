"""Flies a mission from its plugins to its summary."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

from star_core.crew import Crew
from star_core.flight import Flight
from star_core.interrupts import Interrupts
from star_core.manifest import manifest
from star_core.mission import Mission
from star_core.phases import MissionPhase
from star_core.pilot import Pilot
from star_core.registry import Registry


def fly(
    mission: Mission,
    registry: Registry,
    *,
    folder: Path | str | None = None,
    save_frames: bool = False,
    interrupts: Interrupts | None = None,
) -> dict[str, Any]:
    """Fly `mission` and return its summary, as ``summary.json`` keeps it.

    Args:
        mission: What to fly.
        registry: Where its plugins are found; its observers watch.
        folder: Where observers may leave records.
        save_frames: Whether those should hold the cameras' images.
        interrupts: Raised from outside to land (1) or to stop (2 and more).

    Raises:
        PluginError: A plugin cannot be made, or the links cannot be opened; nothing has moved.
    """
    folder = None if folder is None else Path(folder)
    crew = Crew(mission, registry)
    pilot: Pilot | None = None
    try:
        pilot = Pilot(mission, registry, crew, interrupts or Interrupts())
        crew.connect()
        pilot.observers.tell(
            "star_mission_started",
            flight=Flight(mission.name, mission.scene, manifest(mission), folder, save_frames),
        )
        pilot.fly()
    finally:
        wrong = [*(pilot.close() if pilot is not None else ()), *crew.close()]
        if pilot is not None and pilot.reason is not None:  # it began to fly
            for text in wrong:
                pilot.event("failure", text)
            summary = pilot.summary(mission.name)
            pilot.observers.tell("star_mission_ended", summary=deepcopy(summary))
    return summary


def outcome_of(summary: Mapping[str, Any]) -> int:
    """The exit status of a flight: 0 when it completed, else 1."""
    return 0 if summary["outcome"] == MissionPhase.COMPLETED else 1
