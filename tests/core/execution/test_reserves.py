"""Reserves: which agent takes over from which, and when."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from star_core import AgentPhase, Command, Estimate, Goals, InputError, Order, Plan, Telemetry
from star_core.safety.rules import BATTERY_SAG_TIME
from tests.core.conftest import Lab, heard
from tests.core.robots import SOON

TOUR = """
  - climb: {}
  - wait: {seconds: 12}
  - descend: {}
reserve: {agents: [cf3], relieve_below: 3.6, ready_above: 4.0, height: 1.0}
"""
FULL, TIRED = 4.1, 3.5


@pytest.fixture(autouse=True)
def _three(lab: Lab) -> None:
    """Two agents, and a third in reserve, each with a full battery."""
    lab.swarm = ("cf1", "cf2", "cf3")
    lab.spoil("transport", "receive", volts({}))


def volts(since: Mapping[tuple[int, float], float]) -> Callable[..., Telemetry]:
    """Batteries are full, but an agent's is at so many V from a mission time on, s."""

    def battery(now: Telemetry) -> dict[str, list[float]]:
        begun = {row: volt for (row, time), volt in since.items() if now.time >= time}
        return {"battery": [begun.get(row, FULL) for row in range(len(now.age))]}

    return heard(battery)


def agents(lab: Lab, verb: str) -> list[list[str]]:
    (summary,) = lab.summaries
    return [step["agents"] for step in summary["steps"] if step["verb"] == verb]


def test_a_reserve_stays_down_while_no_agent_needs_it(lab: Lab) -> None:
    assert lab.fly(TOUR)["outcome"] == "completed"
    assert lab.went("cf3") == []
    assert agents(lab, "descend") == [["cf1", "cf2"]]


def test_a_reserve_takes_over_from_one_whose_battery_is_low(lab: Lab) -> None:
    lab.spoil("transport", "receive", volts({(0, 2.0): TIRED}))
    summary = lab.fly(TOUR)
    assert summary["outcome"] == "completed"
    assert lab.said("relief") == ["cf3 takes off to relieve cf1", "cf3 takes over"]
    assert lab.went("cf3") == ["taking_off", "flying", "landing", "landed"]
    assert sorted(agents(lab, "descend")[0]) == ["cf2", "cf3"]


def test_relieved_agents_land_at_home_after_the_reserve_arrives(lab: Lab) -> None:
    lab.spoil("transport", "receive", volts({(0, 2.0): TIRED}))
    lab.fly(TOUR)
    when = {(agent, phase): time for time, agent, phase in lab.phases}
    assert when["cf1", "landing"] >= when["cf3", "flying"]
    assert when["cf1", "landed"] < when["cf2", "landing"]
    assert lab.ticks[-1].truth is not None
    assert lab.ticks[-1].truth.position[0] == pytest.approx([0.0, 0.0, 0.0], abs=0.2)


def test_with_a_new_battery_it_is_a_reserve_again(lab: Lab) -> None:
    lab.spoil("transport", "receive", volts({(0, 2.0): TIRED, (0, 9.0): FULL, (1, 9.0): TIRED}))
    lab.fly(TOUR)
    assert lab.said("relief") == [
        "cf3 takes off to relieve cf1",
        "cf3 takes over",
        "cf1 takes off to relieve cf2",
        "cf1 takes over",
    ]
    assert sorted(agents(lab, "descend")[0]) == ["cf1", "cf3"]


def test_a_reserve_whose_battery_is_not_full_stays_down(lab: Lab) -> None:
    lab.spoil("transport", "receive", volts({(0, 2.0): TIRED, (2, 0.0): 3.9}))
    lab.fly(TOUR)
    assert lab.said("relief") == [  # once
        "waiting for a reserve to relieve cf1: cf3 is at 3.90 V, 4 V needed"
    ]


def test_a_battery_that_sags_for_a_moment_is_no_reason(lab: Lab) -> None:
    lab.spoil("transport", "receive", volts({(0, 2.0): TIRED, (0, 2.5): FULL}))
    lab.fly(TOUR)
    assert lab.said("relief") == []


def test_a_reserve_fills_the_place_of_one_that_a_rule_took_out(lab: Lab) -> None:
    lab.spoil("transport", "receive", volts({(0, 2.0): 3.0}))
    summary = lab.fly(f"{TOUR}safety: {{battery_low: {{below: 3.2}}}}\n")
    assert summary["outcome"] == "completed"
    assert "cf3 takes over" in lab.said("relief")
    assert sorted(agents(lab, "descend")[0]) == ["cf2", "cf3"]


def test_no_agent_takes_off_under_another(lab: Lab) -> None:
    lab.spoil("transport", "receive", volts({(0, 2.0): TIRED}))
    lab.fly(TOUR.replace("wait: {seconds: 12}", "visit: {agents: cf2, to: [0, 2, 1]}").replace(
        "  - descend", "  - wait: {seconds: 9}\n  - descend"
    ))  # fmt: skip
    assert lab.said("relief") == ["waiting for a reserve to relieve cf1: cf3 cannot take off yet"]


def test_climbing_reserves_are_down_at_the_end_of_the_mission(lab: Lab) -> None:
    lab.spoil("transport", "receive", volts({(0, 2.0): TIRED}))
    lab.fly(TOUR.replace("seconds: 12", "seconds: 2.2"))
    down = {AgentPhase.GROUNDED, AgentPhase.LANDED}
    assert {AgentPhase(phase) for phase in lab.ticks[-1].health.phase.tolist()} <= down
    assert 2 in lab.ordered(Order.TAKEOFF)


def test_reserves_go_home_if_the_relieved_agent_has_landed(lab: Lab) -> None:
    lab.spoil("transport", "receive", volts({(0, 2.0): TIRED}))
    summary = lab.fly(TOUR.replace("seconds: 12", "seconds: 3.5").replace(
        "descend: {}", "descend: {}\n  - wait: {seconds: 9}"
    ))  # fmt: skip
    assert summary["outcome"] == "completed"
    assert lab.said("relief") == ["cf3 takes off to relieve cf1", "cf3 is not needed any more"]
    assert lab.went("cf3") == ["taking_off", "flying", "landing", "landed"]
    assert agents(lab, "wait")[-1] == ["cf1", "cf2"]


@pytest.mark.parametrize("low_since", [6.9, 7.4])  # relief is due as the landing begins, and later
def test_an_agent_that_moves_aside_to_land_is_not_relieved(lab: Lab, low_since: float) -> None:
    lab.spoil("transport", "receive", volts({(0, low_since): TIRED}))
    lab.fly(TOUR.replace("wait: {seconds: 12}", "visit: {agents: cf1, to: [0, 1, 2]}").replace(
        "  - descend", "  - wait: {seconds: 4}\n  - descend"
    ))  # fmt: skip
    begun = next(time for time, command in lab.robots.commands if command.order is Order.LAND)
    landing = {agent: time for time, agent, phase in lab.phases if phase == "landing"}
    assert begun == landing["cf2"] <= low_since + BATTERY_SAG_TIME + SOON < landing["cf1"]
    assert lab.said("relief") == []
    assert lab.went("cf3") == []


def test_an_agent_that_does_not_get_home_lands_where_it_is(lab: Lab) -> None:
    def stuck(right: Callable[..., Plan], now: Estimate, goals: Goals) -> Plan:
        plan = right(now, goals)
        velocity = np.where(now.time > 6.0, 0.0, plan.setpoint.velocity)
        return replace(plan, setpoint=replace(plan.setpoint, velocity=velocity))

    lab.spoil("transport", "receive", volts({(0, 6.0): TIRED}))
    lab.spoil("planner", "plan", stuck)
    lab.fly(TOUR.replace("wait: {seconds: 12}", "visit: {agents: cf1, to: [1.5, 0, 1]}").replace(
        "  - descend", "  - wait: {seconds: 40, limit: 50}\n  - descend"
    ))  # fmt: skip
    assert "cf1 does not reach its pad and lands at its position" in lab.said("relief")
    assert lab.went("cf1")[-1] == "landed"
    when = {(agent, phase): time for time, agent, phase in lab.phases}
    assert when["cf1", "landed"] < when["cf2", "landing"]


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("[cf3]", "[cf1, cf2, cf3]", "every agent is in reserve; leave one to be relieved"),
        ("[cf3]", "[cf4]", "no agent named 'cf4'; did you mean 'cf3'"),
        ("height: 1.0", "height: 5", "5 m is outside the heights to fly at"),
    ],
)
def test_a_reserve_that_cannot_relieve_is_refused(
    lab: Lab, old: str, new: str, problem: str
) -> None:
    with pytest.raises(InputError, match=problem):
        lab.load(TOUR.replace(old, new))


# Verbs that change the agents of the mission, with the laboratory's own tasks under their names


def test_an_agent_that_joins_is_in_the_steps_that_follow(lab: Lab) -> None:
    lab.fly(TOUR.replace("  - wait", "  - join: {agents: cf3}\n  - wait"))
    assert agents(lab, "climb") == [["cf1", "cf2"]]
    assert agents(lab, "join") == [["cf3"]]
    assert agents(lab, "wait") == [["cf1", "cf2", "cf3"]]


def test_slots_of_agents_that_left_stay_empty(lab: Lab) -> None:
    lab.fly(TOUR.replace("  - wait", "  - leave: {agents: cf2}\n  - wait"))
    assert agents(lab, "wait") == [["cf1"]]
    assert lab.said("relief") == []


def test_a_reserve_that_does_not_climb_is_replaced_by_another(lab: Lab) -> None:
    lab.swarm = ("cf1", "cf2", "cf3", "cf4")
    lab.spoil("transport", "receive", volts({(0, 2.0): TIRED}))

    def deaf(command: Callable[[Command], None], order: Command) -> None:
        if order.order is not Order.TAKEOFF or order.agent.tolist() != [2]:
            command(order)

    lab.spoil("transport", "command", deaf)
    tour = TOUR.replace("seconds: 12", "seconds: 28, limit: 40").replace("[cf3]", "[cf3, cf4]")
    assert lab.fly(tour)["outcome"] == "completed"
    assert lab.said("relief") == [
        "cf3 takes off to relieve cf1",
        "cf3 does not climb and is no reserve any more",
        "cf4 takes off to relieve cf1",
        "cf4 takes over",
    ]
