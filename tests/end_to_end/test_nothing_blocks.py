"""Nothing blocks: any mission, whatever befalls it, ends by itself and accounts for every agent."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, event, given, settings

import star_core as star
from star_core import InputError, fly, hookimpl, load
from star_core.discovery import Source
from star_core.execution.step_run import StepRun
from tests.end_to_end.any_mission import PART, PARTS, Case, cases
from tests.end_to_end.troubled import Troubled

DOWN = ("grounded", "landed")
OUTCOMES = {"completed", "failed", "aborted"}
OF_STEPS = {"success", "failure", "aborted"}
FLOOR = 0.1  # m; a drone that stands is 0.03 m high at most, and noise moves none
LANDING = 20.0  # s: from the greatest height at 0.3 m/s, and 10 s that the core waits longer
TICKS = 2.0  # s: what beginning and ending a step takes


class Witness:
    """Keeps what observers receive, and how long the steps that began may take.

    Attributes:
        phase: Of each agent, last.
        truth: Where the agents really are, last.
        allowed: Until when the flight may last, s.
    """

    def __init__(self) -> None:
        self.phase: dict[str, str] = {}
        self.truth: np.ndarray = np.zeros((0, 3))
        self.allowed = TICKS + 2 * LANDING

    @hookimpl
    def star_phase_changed(self, time: float, agent: str | None, phase: str) -> None:
        if agent is not None:
            self.phase[agent] = phase

    @hookimpl
    def star_ticked(self, tick: star.Tick) -> None:
        if tick.truth is not None:
            self.truth = tick.truth.position

    @contextmanager
    def counting(self) -> Iterator[None]:
        """Add the time-out of each step that begins to what is allowed: one of them is running."""
        begin = StepRun.__init__
        witness = self

        def counted(run: StepRun, *args: Any) -> None:
            begin(run, *args)
            witness.allowed += run.timeout + TICKS

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(StepRun, "__init__", counted)
            yield


def flown(case: Case, folder: Path) -> tuple[Mapping[str, Any], Witness]:
    """Fly a case; return its summary, and what was seen of it."""
    (folder / "world.yaml").write_text(json.dumps(case.world))
    (folder / PART).write_text(json.dumps(PARTS))
    (folder / "mission.yaml").write_text(json.dumps(case.mission))
    witness = Witness()
    registry = Troubled(case.troubles, lambda: witness.allowed).registry()
    registry.add(witness, Source("test:witness", ""))
    try:
        mission = load(folder / "mission.yaml", registry)
    except InputError:
        event("refused")
        assume(False)  # noqa: FBT003 -- hypothesis' own
    with witness.counting():
        return fly(mission, registry, folder=folder / "record"), witness


def ends_well(case: Case) -> Mapping[str, Any]:
    """Fly a case and check everything that is promised of its end; return its summary."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        summary, witness = flown(case, folder)
        record = json.loads((folder / "record" / "summary.json").read_text())
        with np.load(folder / "record" / "trajectory.npz") as trajectory:
            assert all(len(trajectory[key]) >= 0 for key in trajectory)
    assert record["outcome"] == summary["outcome"]
    assert summary["outcome"] in OUTCOMES
    assert bool(summary["reason"]) is (summary["outcome"] != "completed")
    for step in summary["steps"]:
        assert step["outcome"] in OF_STEPS, step
        assert step["ended_s"] >= step["begun_s"]
    accounted(summary, witness)
    return summary


def accounted(summary: Mapping[str, Any], witness: Witness) -> None:
    """Check that every agent is on the ground, or in an event that explains its end."""
    told = [e for e in summary["events"] if e["kind"] in {"failure", "safety", "interrupt"}]
    assert all(e["time"] >= 0 and e["text"] for e in told)
    for row, name in enumerate(summary["agents"]):
        phase = witness.phase.get(name, "grounded")
        named = [e for e in told if name in re.findall(r"\w+", e["text"]) or e.get("agent") == name]
        assert phase in DOWN or named, f"{name} ends {phase}, and nothing says why"
        if phase in DOWN and not named and not summary["collisions"]["agent_obstacle"]:
            assert witness.truth[row, 2] < FLOOR, f"{name} is {phase} in the air"


nothing_blocks = settings(
    deadline=None,
    database=None,
    derandomize=True,
    phases=(Phase.explicit, Phase.generate),  # a flight is too long to shrink by default
    suppress_health_check=list(HealthCheck),
)


@pytest.mark.extended
@settings(nothing_blocks, max_examples=5)
@given(cases())
def test_any_mission_ends_by_itself_and_accounts_for_every_agent(case: Case) -> None:
    ends_well(case)


@pytest.mark.campaign
@settings(nothing_blocks, max_examples=600)  # --hypothesis-show-statistics says how they ended
@given(cases())
def test_generated_missions_end_and_account_for_every_agent(case: Case) -> None:
    event(ends_well(case)["outcome"])
