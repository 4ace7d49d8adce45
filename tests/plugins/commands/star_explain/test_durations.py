"""Durations of rehearsals are those of flights."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core import Registry, fly, load

TOLERANCE = 0.1  # of the duration of the flight


@pytest.mark.parametrize(
    "name", ["each_own_pace", "handover", "safety", "search_flow", "trajectory", "until_low"]
)
def test_a_rehearsal_takes_as_long_as_the_flight(name: str, missions: Path) -> None:
    registry = Registry()
    mission = load(missions / f"{name}.yaml", registry)
    rehearsal = registry.manager.hook.star_rehearse(mission=mission, registry=registry)
    summary = fly(mission, registry)
    assert summary["outcome"] == "completed"
    assert rehearsal.duration == pytest.approx(summary["steps"][-1]["ended_s"], rel=TOLERANCE)
