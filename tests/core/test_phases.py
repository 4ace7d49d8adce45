"""Phases: every row of the two tables, and nothing beside them."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import AgentPhase, Supervisor
from star_core.phases import MissionPhase, Phases

GROUNDED, TAKING_OFF, FLYING, LANDING, LANDED, LOST, EMERGENCY = AgentPhase
IDLE, IN_FLIGHT, COMING_DOWN, COMPLETED, FAILED, ABORTED = MissionPhase

WAYS = {  # triggers that lead to a phase
    GROUNDED: [],
    TAKING_OFF: ["take_off"],
    FLYING: ["take_off", "climbed"],
    LANDING: ["take_off", "climbed", "land"],
    LANDED: ["take_off", "climbed", "land", "down"],
    LOST: ["take_off", "climbed", "lose"],
    EMERGENCY: ["fail"],
}
LEADS = {
    ("take_off", GROUNDED): TAKING_OFF,
    ("take_off", LANDED): TAKING_OFF,
    ("climbed", TAKING_OFF): FLYING,
    ("lose", TAKING_OFF): LOST,
    ("lose", FLYING): LOST,
    ("find", LOST): FLYING,
    ("land", TAKING_OFF): LANDING,
    ("land", FLYING): LANDING,
    ("land", LOST): LANDING,
    ("down", LANDING): LANDED,
} | {("fail", phase): EMERGENCY for phase in AgentPhase}
TRIGGERS = sorted({trigger for trigger, _ in LEADS})

MISSION_WAYS = {
    IDLE: [],
    IN_FLIGHT: ["start"],
    COMING_DOWN: ["start", "land"],
    COMPLETED: ["start", "land", "complete"],
    FAILED: ["fail"],
    ABORTED: ["abort"],
}
MISSION_LEADS = (
    {
        ("start", IDLE): IN_FLIGHT,
        ("land", IN_FLIGHT): COMING_DOWN,
        ("complete", COMING_DOWN): COMPLETED,
    }
    | {("fail", phase): FAILED for phase in MissionPhase}
    | {("abort", phase): ABORTED for phase in MissionPhase}
)
MISSION_TRIGGERS = sorted({trigger for trigger, _ in MISSION_LEADS})


def agent_in(phase: AgentPhase) -> Phases:
    """One agent that went into a phase."""
    phases = Phases(("cf1",))
    for trigger in WAYS[phase]:
        phases.fire(trigger, [0])
    assert phases.of_agents().tolist() == [phase]
    list(phases.changes())
    return phases


@pytest.mark.parametrize("phase", AgentPhase)
@pytest.mark.parametrize("trigger", TRIGGERS)
def test_a_trigger_leads_an_agent_as_in_the_table_or_nowhere(
    trigger: str, phase: AgentPhase
) -> None:
    phases = agent_in(phase)
    phases.fire(trigger, [0])
    next_phase = LEADS.get((trigger, phase), phase)
    assert phases.of_agents().tolist() == [next_phase]
    assert list(phases.changes()) == (
        [] if next_phase is phase else [("cf1", next_phase.name.lower())]
    )


@pytest.mark.parametrize("phase", MissionPhase)
@pytest.mark.parametrize("trigger", MISSION_TRIGGERS)
def test_a_trigger_leads_the_mission_as_in_the_table_or_nowhere(
    trigger: str, phase: MissionPhase
) -> None:
    phases = Phases(())
    for way in MISSION_WAYS[phase]:
        phases.fire_mission(way)
    list(phases.changes())
    phases.fire_mission(trigger)
    next_phase = MISSION_LEADS.get((trigger, phase), phase)
    assert phases.mission is next_phase
    assert list(phases.changes()) == ([] if next_phase is phase else [(None, str(next_phase))])


def observed(
    phase: AgentPhase,
    state: Supervisor,
    *,
    heard: bool = True,
    located: bool = True,
    settled: bool = True,
) -> AgentPhase:
    phases = agent_in(phase)
    phases.observe(np.array([int(state)]), *map(np.array, ([heard], [located], [settled])))
    return AgentPhase(phases.of_agents()[0])


AT_REST = Supervisor(0)
UP = Supervisor.FLYING
DONE = Supervisor.COMMANDER_FINISHED


@pytest.mark.parametrize(
    ("before", "state", "after"),
    [
        (GROUNDED, AT_REST, GROUNDED),
        (GROUNDED, UP | DONE, GROUNDED),
        (TAKING_OFF, UP, TAKING_OFF),
        (TAKING_OFF, DONE, TAKING_OFF),
        (TAKING_OFF, UP | DONE, FLYING),
        (FLYING, UP, FLYING),
        (FLYING, DONE, FLYING),
        (LANDING, UP | DONE, LANDING),
        (LANDING, AT_REST, LANDING),
        (LANDING, DONE, LANDED),
        (LANDED, UP | DONE, LANDED),
        (LOST, UP, FLYING),
        (LOST, DONE, LOST),
        (EMERGENCY, UP | DONE, EMERGENCY),
    ],
)
def test_what_an_agent_reports_moves_it_on(
    before: AgentPhase, state: Supervisor, after: AgentPhase
) -> None:
    assert observed(before, state) is after


def test_an_agent_that_still_climbs_has_not_taken_off() -> None:
    assert observed(TAKING_OFF, UP | DONE, settled=False) is TAKING_OFF
    phases = agent_in(TAKING_OFF)
    yes, state = np.array([True]), np.array([int(UP | DONE)])
    phases.observe(state, yes, yes, ~yes)
    phases.observe(state, yes, yes, yes)
    assert phases.of_agents().tolist() == [FLYING]


@pytest.mark.parametrize("bit", [Supervisor.TUMBLED, Supervisor.LOCKED, Supervisor.CRASHED])
@pytest.mark.parametrize("phase", AgentPhase)
def test_an_agent_that_has_fallen_is_in_an_emergency(phase: AgentPhase, bit: Supervisor) -> None:
    assert observed(phase, bit | DONE) is EMERGENCY


@pytest.mark.parametrize("state", [Supervisor.CRASHED, UP | DONE])
@pytest.mark.parametrize("phase", [GROUNDED, LANDING, LANDED, LOST])
def test_what_an_agent_reported_long_ago_means_nothing(
    phase: AgentPhase, state: Supervisor
) -> None:
    assert observed(phase, state, heard=False) is phase


@pytest.mark.parametrize(("heard", "located"), [(False, True), (True, False), (False, False)])
@pytest.mark.parametrize(
    ("before", "after"),
    [
        (GROUNDED, GROUNDED),
        (TAKING_OFF, LOST),
        (FLYING, LOST),
        (LANDING, LANDING),
        (LANDED, LANDED),
        (LOST, LOST),
        (EMERGENCY, EMERGENCY),
    ],
)
def test_flying_agents_not_heard_or_located_are_lost(
    before: AgentPhase,
    after: AgentPhase,
    heard: bool,  # noqa: FBT001 -- what is reported
    located: bool,  # noqa: FBT001
) -> None:
    assert observed(before, UP, heard=heard, located=located) is after


@pytest.mark.parametrize(("heard", "located"), [(False, True), (True, False)])
def test_agents_are_lost_although_their_reports_do_not_change(
    heard: bool,  # noqa: FBT001 -- what is reported
    located: bool,  # noqa: FBT001
) -> None:
    phases = agent_in(FLYING)
    state, yes = np.array([int(UP)]), np.array([True])
    phases.observe(state, yes, yes, yes)
    phases.observe(state, np.array([heard]), np.array([located]), yes)
    assert phases.of_agents().tolist() == [LOST]


def test_each_agent_goes_its_own_way() -> None:
    phases = Phases(("cf1", "cf2", "cf3"))
    phases.fire("take_off", [0, 2])
    state = np.array([int(UP | DONE)] * 3)
    every = np.array([True] * 3)
    phases.observe(state, np.array([True, True, False]), every, every)
    assert phases.of_agents().tolist() == [FLYING, GROUNDED, LOST]
    assert list(phases.changes()) == [
        ("cf1", "taking_off"),
        ("cf3", "taking_off"),
        ("cf1", "flying"),
        ("cf3", "lost"),
    ]


def test_an_answer_stays_as_it_was_when_agents_move_on() -> None:
    phases = Phases(("cf1",))
    before = phases.of_agents()
    phases.fire("take_off", [0])
    assert before.tolist() == [GROUNDED]


def test_agents_are_found_by_any_of_some_phases() -> None:
    phases = Phases(("cf1", "cf2", "cf3"))
    phases.fire("take_off", [1])
    phases.fire("fail", [2])
    assert phases.among(TAKING_OFF, EMERGENCY).tolist() == [False, True, True]


BITS = [0, *(int(bit) for bit in Supervisor)]
