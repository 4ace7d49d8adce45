"""Verbs that wait for agents, and that go on without some of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from star_core import AgentPhase, Health, Status
from star_core.testing import estimate, health, scene
from tests.plugins.tasks.conftest import Changing, fly, make

LEFT = 2.0  # s
STAYING = (0, 2)
AIR = [[-1.0, 0.0, 0.8], [0.0, 0.0, 0.8], [1.0, 0.0, 0.8]]
FLYING: dict[str, dict[str, Any]] = {
    "goto": {"to": [0.0, 1.0, 0.8]},
    "hold": {"at": [0.0, 1.0, 0.8], "for": 3.0},
    "follow": {"path": "box", "size": 2.0, "centre": [0.0, 1.0, 0.8]},
}


def stuck(time: float) -> Any:
    return np.array([False, time > 1.0, False])


@pytest.mark.parametrize("verb", FLYING)
def test_without_one_that_is_stuck_the_others_are_done(verb: str) -> None:
    room = scene(3)
    whole = fly(make(verb, room, (0, 1, 2), **FLYING[verb]), room, AIR, stuck=stuck)
    assert whole.status is Status.RUNNING
    task = Changing(make(verb, room, (0, 1, 2), **FLYING[verb]), LEFT, "on_agents_removed", STAYING)
    flown = fly(task, room, AIR, stuck=stuck)
    assert flown.status is Status.SUCCESS
    assert flown.goals[-1].active.tolist() == [True, False, True]


@pytest.mark.parametrize("verb", FLYING)
def test_an_agent_that_stays_flies_where_it_would_have_flown(verb: str) -> None:
    room = scene(3)
    whole = fly(make(verb, room, (0, 1, 2), **FLYING[verb]), room, AIR)
    task = Changing(make(verb, room, (0, 1, 2), **FLYING[verb]), LEFT, "on_agents_removed", STAYING)
    flown = fly(task, room, AIR)
    for row in STAYING:
        assert flown.end[row] == pytest.approx(whole.end[row], abs=0.1)


@pytest.mark.parametrize("verb", [*FLYING, "formation"])
def test_no_agent_departs_before_all_are_located(verb: str) -> None:
    room = scene(3)
    line = {"shape": "line", "centre": [0.0, 1.0, 0.8]}
    task = make(verb, room, (0, 1, 2), **FLYING.get(verb, line))
    flown = fly(task, room, AIR, located=lambda time: np.array([True, time >= 1.0, True]))
    assert flown.goals[:20] == [None] * 20
    assert flown.goals[20] is not None
    assert flown.status is Status.SUCCESS


@pytest.mark.parametrize(
    ("verb", "begins", "ends"),
    [
        ("takeoff", AgentPhase.GROUNDED, AgentPhase.FLYING),
        ("land", AgentPhase.FLYING, AgentPhase.LANDED),
    ],
)
def test_an_agent_that_stays_climbs_and_descends(
    verb: str, begins: AgentPhase, ends: AgentPhase
) -> None:
    now = estimate(np.array(AIR))
    phases = np.full(3, int(ends))
    phases[1] = int(begins)  # the one that leaves never gets there
    task = make(verb, scene(3), (0, 1, 2))
    task.begin(now, health(3, begins))
    task.step(now, health(3, begins))
    at_end = Health(phases, np.full(3, 4.0), np.zeros(3))
    assert task.step(now, at_end).status is Status.RUNNING
    task.on_agents_removed(STAYING)
    assert task.step(now, at_end).status is Status.SUCCESS


def test_agents_that_wait_get_no_goals() -> None:
    room = scene(3)
    flown = fly(make("wait", room, (0, 1, 2)), room, AIR, longest=3.0)
    assert flown.status is Status.RUNNING
    assert set(flown.goals) == {None}
