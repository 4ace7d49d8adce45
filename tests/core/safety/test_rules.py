"""Safety rules: which agents leave a mission, when, and how the others go on without them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from star_core import AgentPhase, Array, Estimate, Order, Supervisor, Telemetry
from star_core.plugin_support.option_schema import fill_defaults
from star_core.safety.monitors import SafetyAction, TickState
from star_core.safety.rules import BATTERY_SAG_TIME, SUNK_TIME, Rules
from star_core.testing import estimate, health, scene
from star_core.testing.inputs import flight_telemetry
from star_yaml.schema import load
from tests.core.conftest import Lab, heard
from tests.core.test_executor import silent

TOUR = """
  - climb: {}
  - visit: {to: [3, 0, 1]}
  - descend: {}
safety: """


def judged(
    rules: dict[str, dict[str, Any]],
    seconds: float,
    *,
    position: Array | None = None,
    valid: bool = True,
    **changes: Any,
) -> list[tuple[float, int, SafetyAction]]:
    """Time, row and action of the rules that fire if the first agent is in trouble from 1 s on."""
    schema = load("mission")
    filled = fill_defaults(rules, schema["properties"]["safety"], schema["$defs"])
    watch = Rules(scene(2), filled)
    home = np.array([[0.0, 0, 1], [1.0, 0, 1]])
    fired = []
    for k in range(round(seconds / 0.1) + 1):
        time, well, where = k / 10, estimate(home, time=k / 10), health(2)
        if time >= 1.0 - 1e-9:
            well = replace(well, valid=np.array([valid, True]))
            if position is not None:
                well = replace(well, position=np.stack([position, home[1]]))
            for name, new in changes.items():
                where = replace(where, **{name: np.array([new, getattr(where, name)[1]])})
        none = np.zeros(2, np.bool_)
        state = TickState(flight_telemetry(scene(2), time, none, none), where.phase, none)
        state.estimate, state.health = well, where
        fired += [(round(time, 6), f.row, f.action) for f in watch.check(state) if watch.record(f)]
    return fired


def test_a_battery_is_low_when_it_stays_low() -> None:
    rules = {"battery_low": {"below": 3.4, "then": "land"}}
    assert judged(rules, 5.0, battery=3.3) == [(1.0 + BATTERY_SAG_TIME, 0, SafetyAction.LAND)]
    assert judged(rules, 5.0, battery=3.5) == []
    assert judged(rules, 1.0 + BATTERY_SAG_TIME - 0.1, battery=3.3) == []


def test_a_link_is_lost_when_nothing_is_heard_for_so_long() -> None:
    assert judged({"link_lost": {"after": 2.0}}, 3.0, age=2.1) == [(1.0, 0, SafetyAction.LAND)]
    assert judged({"link_lost": {"after": 2.0}}, 3.0, age=1.9) == []


def test_position_lost_applies_to_airborne_agents_after_its_time() -> None:
    rules = {"position_lost": {"after": 0.5, "then": "stop"}}
    assert judged(rules, 3.0, valid=False) == [(1.5, 0, SafetyAction.STOP)]
    assert judged(rules, 3.0, valid=False, phase=AgentPhase.GROUNDED) == []


def test_the_fence_is_near_from_every_side() -> None:
    rules = {"fence_near": {"within": 0.2, "then": "hold"}}
    for place in ([9.85, 0, 1], [-9.85, 0, 1], [0, 9.9, 1], [0, 0, 2.9], [0, 0, 0.1], [11, 0, 1]):
        assert judged(rules, 3.0, position=np.array(place)) == [(1.0, 0, SafetyAction.HOLD)]
    assert judged(rules, 3.0, position=np.array([9.75, 0, 1])) == []


def test_an_agent_that_tumbled_is_out() -> None:
    assert judged({"tumbled": {"then": "stop"}}, 3.0, phase=AgentPhase.EMERGENCY) == [
        (1.0, 0, SafetyAction.STOP)
    ]


def test_agents_that_sink_to_the_floor_in_flight_are_tumbled() -> None:
    rules, floor = {"tumbled": {"then": "stop"}}, np.array([0.0, 0, 0.05])
    assert judged(rules, 5.0, position=floor) == [(1.0 + SUNK_TIME, 0, SafetyAction.STOP)]
    assert judged(rules, 1.0 + SUNK_TIME - 0.1, position=floor) == []
    assert judged(rules, 5.0, position=floor, phase=AgentPhase.LANDING) == []
    assert judged(rules, 5.0, position=np.array([0.0, 0, 0.15])) == []
    fallen = judged(rules, 5.0, position=floor, phase=AgentPhase.EMERGENCY)
    assert fallen == [(1.0, 0, SafetyAction.STOP)]


def test_a_rule_fires_once_and_only_a_graver_answer_goes_over_it() -> None:
    rules = {
        "link_lost": {"after": 0.1, "then": "land"},
        "battery_low": {"below": 3.4, "then": "hold"},
        "position_lost": {"after": 1.5, "then": "stop"},
    }
    assert judged(rules, 9.0, age=0.3, battery=3.0, valid=False) == [
        (1.0, 0, SafetyAction.LAND),
        (2.5, 0, SafetyAction.STOP),
    ]


# In flight


def reported(lab: Lab) -> list[str]:
    return [text for text in lab.said("safety") if ": " in text]


def test_unheard_agents_land_and_the_others_do_their_step(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(1, 1.5, np.inf, age=0.7))
    summary = lab.fly(f"{TOUR}{{link_lost: {{after: 0.6}}}}")
    assert reported(lab) == ["cf2 lands: link_lost: not heard for 0.7 s"]
    assert [e["agent"] for e in summary["events"] if e["kind"] == "safety"] == ["cf2"]
    assert lab.went("cf2")[:4] == ["taking_off", "flying", "lost", "landing"]
    assert [step["outcome"] for step in summary["steps"]] == ["success"] * 3
    assert lab.went("cf1") == ["taking_off", "flying", "landing", "landed"]
    assert summary["outcome"] == "completed"


def test_one_that_is_lost_for_a_while_only_flies_on(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(1, 1.5, 2.2, age=0.7))
    summary = lab.fly(
        "\n  - climb: {}\n  - parallel: [visit: {agents: cf1, to: [3, 0, 1]},"
        " visit: {agents: cf2, to: [3, 2, 1]}]\n  - descend: {}\nsafety: {link_lost: {after: 0.8}}"
    )
    assert reported(lab) == []
    assert summary["outcome"] == "completed"
    assert lab.went("cf2") == ["taking_off", "flying", "lost", "flying", "landing", "landed"]


def test_one_that_holds_stays_where_it_is_until_the_end(lab: Lab) -> None:
    lab.spoil("transport", "receive", battery(1, 3.0, since=1.5))
    summary = lab.fly(f"{TOUR}{{battery_low: {{below: 3.4, then: hold}}}}")
    assert reported(lab) == ["cf2 holds its position: battery_low: battery at 3.00 V"]
    assert summary["outcome"] == "completed"
    (held,) = {time for time, command in lab.robots.commands
               if command.order is Order.LAND and 1 in command.agent}  # fmt: skip
    last = max(event.time for event in lab.events if event.kind == "step")
    assert held >= last


def test_motors_stop_by_a_rule(lab: Lab) -> None:
    lab.spoil("transport", "receive", battery(1, 3.0, since=1.5))
    lab.fly(f"{TOUR}{{battery_low: {{below: 3.4, then: stop}}}}")
    assert lab.ordered(Order.STOP) == [1]
    assert 0 not in lab.ordered(Order.STOP)


def test_a_mission_fails_when_the_rules_leave_no_agent(lab: Lab) -> None:
    low = heard(lambda now: {"battery": np.full(2, 3.0 if now.time > 1.5 else 4.0)})
    lab.spoil("transport", "receive", low)
    summary = lab.fly(f"{TOUR}{{battery_low: {{}}}}")
    assert (summary["outcome"], summary["reason"]) == ("failed", "the safety rules left no agent")
    assert sorted(lab.ordered(Order.LAND)) == [0, 1]


def test_one_that_tumbles_is_left_to_itself(lab: Lab) -> None:
    bit = int(Supervisor.TUMBLED)
    fallen = heard(lambda now: {"state": now.state | [0, bit * (now.time > 1.5)]})
    lab.spoil("transport", "receive", fallen)
    summary = lab.fly(f"{TOUR}{{tumbled: {{then: stop}}}}")
    assert summary["outcome"] == "completed"
    assert lab.went("cf1") == ["taking_off", "flying", "landing", "landed"]


def test_tasks_without_agent_methods_are_made_again(lab: Lab) -> None:
    lab.spoil("transport", "receive", battery(1, 3.0, since=1.0))
    summary = lab.fly("\n  - climb: {}\n  - wait: {seconds: 4}\nsafety: {battery_low: {}}")
    (wait,) = (step for step in summary["steps"] if step["verb"] == "wait")
    assert wait["outcome"] == "success"
    assert wait["ended_s"] - wait["begun_s"] > 4.5  # the laboratory's `wait` has no such methods


def battery(row: int, volt: float, since: float) -> Callable[..., Telemetry]:
    """An agent's battery is at `volt` from a mission time on, s."""

    def volts(now: Telemetry) -> dict[str, Any]:
        falls = (np.arange(len(now.age)) == row) & (now.time > since)
        return {"battery": np.where(falls, volt, 4.0)}

    return heard(volts)


def test_unlocated_agents_are_excused_only_under_a_rule(lab: Lab) -> None:
    def blind(right: Callable[..., Estimate], *args: Any) -> Estimate:
        answer = right(*args)
        return replace(answer, valid=np.array([True, answer.time < 1.5]))

    lab.spoil("localizer", "locate", blind)
    summary = lab.fly(f"{TOUR}{{position_lost: {{after: 0.5}}}}")
    assert summary["outcome"] == "completed"
    assert reported(lab) == ["cf2 lands: position_lost: not located for 0.5 s"]
