"""Where agents are in a rehearsal."""

from __future__ import annotations

import gc
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from weakref import ref

import numpy as np
import pytest

from star_core import AgentPhase, Registry, load
from star_core.discovery import Source
from tests.plugins.commands.star_explain.conftest import Rehearse

MISSION = """\
star: 1
name: turns
world: hall.yaml
swarm: {a: {start: [0, 0, 0]}, b: {start: [0, 3, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {height: 0.8}
  - goto: {agents: a, to: [5, 0, 0.8], speed: 0.2}
  - goto: {agents: b, to: [5, 3, 0.8]}
  - land: {}
"""


@pytest.fixture
def rehearsed(rehearse: Rehearse) -> Rehearse:
    return partial(rehearse, MISSION)


def test_agents_hover_where_their_last_step_ended(rehearsed: Rehearse) -> None:
    rehearsal = rehearsed()
    time, position, _, airborne = rehearsal.sampled(0.5)
    _, first, second, _ = rehearsal.steps
    waits = (time > first.begun) & (time < first.ended)
    assert airborne[waits].all()
    assert np.allclose(position[waits, 1], [0.0, 3.0, 0.8], atol=0.06)  # b, while a flies
    stays = (time > second.begun + 1.0) & (time < second.ended)
    assert np.allclose(position[stays, 0], [5.0, 0.0, 0.8], atol=0.06)


def test_a_mission_that_is_checked_is_rehearsed_once(missions: Path) -> None:
    first, second = Registry(), Registry()
    mission = load(missions / "hello.yaml", first)
    list(first.manager.hook.star_check(mission=mission, registry=first))
    rehearsals = [
        registry.manager.hook.star_rehearse(mission=mission, registry=registry)
        for registry in (first, first, second)
    ]
    assert rehearsals[0] is rehearsals[1] is not rehearsals[2]
    assert not rehearsals[0].position.flags.writeable  # what one plugin receives, others do too


def test_a_rehearsal_keeps_neither_mission_nor_plugins(missions: Path) -> None:
    registry = Registry()
    mission = load(missions / "hello.yaml", registry)
    registry.add(SimpleNamespace(mission=mission), Source("a:observer"))
    registry.manager.hook.star_rehearse(mission=mission, registry=registry)
    kept = ref(mission), ref(registry)
    del mission, registry
    gc.collect()
    assert [kept[0](), kept[1]()] == [None, None]


def test_repeated_steps_are_rehearsed_as_often(rehearsed: Rehearse) -> None:
    outbound = "{goto: {agents: a, to: [1, 0, 0.8]}}"
    inbound = "{goto: {agents: a, to: [0, 0, 0.8]}}"
    once, thrice = (
        rehearsed(f"mission.1={{repeat: {{times: {times}, steps: [{outbound}, {inbound}]}}}}")
        for times in (1, 3)
    )
    verbs = ["takeoff", *["goto", "goto"] * 3, "goto", "land"]
    assert [step.action.verb for step in thrice.steps] == verbs
    round_trip = once.steps[2].ended - once.steps[1].begun
    assert thrice.time[-1] - once.time[-1] == pytest.approx(2 * round_trip, abs=0.3)


def test_tracks_have_the_phases_and_the_goals(rehearsed: Rehearse) -> None:
    rehearsal = rehearsed()
    climb, transit, *_, landing = rehearsal.steps
    phases = rehearsal.phase[rehearsal.during(climb), 0].tolist()
    middle = len(phases) // 2
    expected = AgentPhase.GROUNDED, AgentPhase.TAKING_OFF, AgentPhase.FLYING
    assert (phases[0], phases[middle], phases[-1]) == expected
    assert rehearsal.phase[-1].tolist() == [AgentPhase.LANDED] * 2
    assert rehearsal.position[-1, :, 2].tolist() == [0.0, 0.0]
    assert rehearsal.last_goals(transit)[0].tolist() == [5.0, 0.0, 0.8]
    assert landing.ended == rehearsal.time[-1] == rehearsal.duration


def test_a_path_has_its_corners(rehearsed: Rehearse) -> None:
    rehearsal = rehearsed()
    path = rehearsal.path(rehearsal.steps[1], 0)
    assert len(path) == 2
    assert path == pytest.approx(np.array([[0, 0, 0.8], [5, 0, 0.8]]), abs=0.1)
