"""Flights that a program steps and commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import (
    AgentPhase,
    Command,
    Goals,
    InputError,
    Operator,
    Order,
    Registry,
    Setpoint,
    StarError,
    fly,
    load,
    open_flight,
)
from star_core.runner import OpenFlight
from tests.commands import position_and_code
from tests.core.conftest import TOUR, Lab, heard

SIM = ["transport.noise=false", "transport.profile=ideal", "localizer=flow"]


@pytest.fixture
def flight(lab: Lab) -> Iterator[OpenFlight]:
    """A flight of the lab, whose agents are in the air."""
    with open_flight(lab.load(), lab.registry) as flight:
        flight.run("climb")
        yield flight


def goals(*position: list[float], active: list[bool]) -> Goals:
    n = len(active)
    still = np.zeros((n, 3))
    return Goals(np.array(position), still, np.zeros(n), np.full(n, 0.5), np.array(active))


def setpoint(*velocity: list[float], active: list[bool]) -> Setpoint:
    return Setpoint(np.array(velocity), np.zeros(len(active)), np.array(active))


def code(call: Callable[..., object], *arguments: Any, **options: Any) -> str:
    """Return the code of the error that a call raises."""
    with pytest.raises(StarError) as raised:
        call(*arguments, **options)
    return raised.value.code


def test_a_program_flies_steps_and_all_agents_land(lab: Lab) -> None:
    with open_flight(lab.load(), lab.registry) as flight:
        assert flight.run("climb") == "success"
        assert flight.run("visit", agents="cf1", to=[1, 0, 1]) == "success"
        assert flight.tick.estimate.position[0] == pytest.approx([1, 0, 1])
    summary = flight.close()
    assert summary["outcome"] == "completed", summary["reason"]
    assert [step["verb"] for step in summary["steps"]] == ["climb", "visit"]
    assert lab.went("cf2")[-1] == "landed"
    assert lab.summaries == [summary]


def test_a_step_that_a_program_starts_names_its_line(lab: Lab) -> None:
    with open_flight(lab.load(), lab.registry) as flight:
        flight.start("climb", agents="cf2")
        flight.step()
    (step,) = flight.close()["steps"]
    first = test_a_step_that_a_program_starts_names_its_line.__code__.co_firstlineno
    assert step["location"] == f"{__file__}:{first + 2}:1"
    assert step["agents"] == ["cf2"]
    assert step["outcome"] == "aborted"


def test_an_agent_leaves_the_step_it_is_in(flight: OpenFlight) -> None:
    first = flight.start("wait", seconds=5)
    flight.step()
    second = flight.start("visit", agents="cf1", to=[0.5, 0, 1])
    flight.wait(3)
    assert (first.outcome, second.outcome) == (None, "success")
    flight.start("wait", agents="cf2", seconds=1)
    flight.wait(0.2)
    assert first.outcome == "aborted"


def test_goals_are_flown_to_and_kept(flight: OpenFlight) -> None:
    flight.set_goals(goals([1, 0, 1.5], [0, 0, 0], active=[True, False]))
    tick = flight.wait(4)
    assert tick.estimate.position == pytest.approx(np.array([[1, 0, 1.5], [0, 1, 1]]))
    assert tick.goals.position[0] == pytest.approx([1, 0, 1.5])


def test_a_setpoint_lasts_one_tick_then_agents_hold(flight: OpenFlight) -> None:
    for _ in range(5):
        flight.set_setpoint(setpoint([0.2, 0, 0], [9, 9, 9], active=[True, False]))
        tick = flight.step()
        assert tick.plan.setpoint.velocity[0] == pytest.approx([0.2, 0, 0])
        assert tick.sent.velocity[1] == pytest.approx([0, 0, 0])
    stopped = flight.step().estimate.position[0]
    assert stopped == pytest.approx([0.1, 0, 1], abs=0.03)
    assert flight.wait(1).estimate.position[0] == pytest.approx(stopped, abs=0.03)


def test_full_states_of_a_program_are_sent_and_bounded(flight: OpenFlight) -> None:
    position = flight.tick.estimate.position
    for lead, follows in ((0.1, True), (0.5, False)):
        full_state = replace(
            setpoint([0.3, 0, 0], [0, 0, 0], active=[True, False]),
            position=position + np.array([lead, 0, 0]),
            acceleration=np.zeros((2, 3)),
        )
        flight.set_setpoint(full_state)
        assert flight.step().sent.followed().tolist() == [follows, False]


def test_the_safety_filter_limits_setpoints_of_a_program(flight: OpenFlight) -> None:
    flight.set_setpoint(setpoint([5, 0, 0], [0, 0, 0], active=[True, True]))
    tick = flight.step()
    assert np.linalg.norm(tick.sent.velocity[0]) <= flight.scene.limits.speed + 1e-9
    assert tick.corrected.speed.tolist() == [True, False]


def test_commands_reach_the_agents(lab: Lab, flight: OpenFlight) -> None:
    rows = np.array([1])
    floor = np.array([[np.nan, np.nan, 0.0]])
    flight.send(Command(Order.LAND, rows, floor, np.zeros(1), np.ones(1)))
    flight.wait(6)
    assert lab.ordered(Order.LAND) == [1]
    assert flight.tick.health.phase.tolist() == [AgentPhase.FLYING, AgentPhase.LANDED]


def test_mission_steps_are_flown_until_a_program_takes_over(lab: Lab) -> None:
    with open_flight(lab.load(), lab.registry, steps=True) as flight:
        flight.wait(1.5)
        started = flight.start("visit", agents="cf1", to=[1, 0, 1])
        while not flight.over:
            flight.step()
    summary = flight.close()
    assert started.outcome == "success"
    assert [step["verb"] for step in summary["steps"]] == ["climb", "wait", "visit", "descend"]
    assert summary["steps"][-1]["agents"] == ["cf2"]
    assert lab.went("cf1")[-1] == "landed"


def test_fly_and_a_program_that_steps_fly_the_same(lab: Lab) -> None:
    fly(lab.load(TOUR), lab.registry)
    flown = [tick.sent.velocity.tolist() for tick in lab.ticks]
    lab.ticks.clear()
    with open_flight(lab.load(TOUR), lab.registry, steps=True) as flight:
        while not flight.over:
            flight.step()
    assert [tick.sent.velocity.tolist() for tick in lab.ticks] == flown


def test_a_failed_step_ends_the_flight_with_its_reason(lab: Lab, flight: OpenFlight) -> None:
    assert code(flight.run, "wait", seconds=0.3, fails="no luck") == "flight-ended"
    assert code(flight.step) == "flight-ended"
    summary = flight.close()
    assert summary["outcome"] == "failed"
    assert summary["reason"].endswith("no luck")
    assert lab.went("cf1")[-1] == "landed"


def test_a_step_may_fail_without_ending_the_flight(flight: OpenFlight) -> None:
    assert flight.run("wait", seconds=0.3, fails="no luck", on_failure="continue") == "failure"
    assert not flight.over
    assert flight.close()["outcome"] == "completed"


def test_an_error_in_the_program_lands_all_agents(lab: Lab) -> None:
    def program() -> None:
        with open_flight(lab.load(), lab.registry) as flight:
            flight.run("climb")
            flight.start("wait", agents="cf7")

    with pytest.raises(InputError):
        program()
    (summary,) = lab.summaries
    assert summary["outcome"] == "aborted"
    assert summary["reason"].startswith("the program raised InputError: no agent or group named")
    assert lab.went("cf1")[-1] == "landed"


def test_a_plugin_that_fails_ends_the_flight(lab: Lab) -> None:
    lab.spoil("transport", "wait", RuntimeError("boom"), range(30, 31))
    with open_flight(lab.load(), lab.registry) as flight:
        flight.run("climb")
        assert code(flight.wait, 9) == "plugin-failed"
    summary = flight.close()
    assert summary["outcome"] == "failed"
    assert "boom" in summary["reason"]
    assert lab.went("cf1")[-1] == "landed"


def test_the_operator_ends_the_flight_of_a_program(lab: Lab) -> None:
    operator = Operator()
    with open_flight(lab.load(), lab.registry, operator=operator) as flight:
        flight.run("climb")
        operator.land_all()
        assert code(flight.step) == "flight-ended"
    assert flight.close()["outcome"] == "aborted"


def test_a_flight_without_a_tick_has_no_tables(lab: Lab) -> None:
    with open_flight(lab.load(), lab.registry) as flight:
        assert flight.time == 0.0
        assert code(lambda: flight.tick) == "invalid-argument"
    assert flight.close()["outcome"] == "completed"


def test_tables_of_another_swarm_are_refused(flight: OpenFlight) -> None:
    nan = setpoint([np.nan, 0, 0], [0, 0, 0], active=[True, True])
    assert code(flight.set_goals, goals([0, 0, 1], active=[True])) == "contract-broken"
    assert code(flight.set_setpoint, nan) == "contract-broken"
    assert code(flight.send, None) == "contract-broken"


def test_wrong_steps_of_a_program_are_refused(flight: OpenFlight) -> None:
    assert code(flight.start, "visit", agents="cf7") == "unknown-agent"
    with pytest.raises(InputError) as raised:
        flight.start("visit", at=1)
    line = test_wrong_steps_of_a_program_are_refused.__code__.co_firstlineno + 3
    assert position_and_code(str(raised.value)) == f"{__file__}:{line}:1 [unknown-option]"


def test_verbs_of_missions_are_checked_as_in_missions() -> None:
    registry = Registry()
    mission = load("first_flight", registry, SIM)
    with open_flight(mission, registry) as flight:
        assert code(flight.start, "takeoff", height=9) == "outside-geofence"
        assert code(flight.start, "takeoff", height="high") == "invalid-option"
        assert code(flight.start, "goto", by=[0, 0, 0.2]) == "wrong-airborne-state"


def test_a_landed_rule_agent_ignores_its_program(lab: Lab) -> None:
    rules = "safety: {battery_low: {below: 3.5, then: land}}\n"

    low = heard(lambda now: {"battery": [4.0 - (now.time > 3), 4.0]})
    lab.spoil("transport", "receive", low)
    with open_flight(lab.load(more=rules), lab.registry) as flight:
        flight.run("climb")
        for _ in range(150):
            flight.set_setpoint(setpoint([0.3, 0, 0], [0, 0, 0], active=[True, True]))
            flight.step()
        assert flight.tick.health.phase.tolist() == [AgentPhase.LANDED, AgentPhase.FLYING]
        assert code(flight.start, "wait", agents="cf1", seconds=1) == "agent-not-in-mission"
