"""Steps that need agents in the air, or on the ground, and find them elsewhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core import InputError, Registry, load

HEAD = """\
star: 1
name: m
world: room.yaml
swarm:
  cf1: {start: [-0.5, 0, 0], camera: aideck}
  cf2: {start: [0.5, 0, 0]}
  cf3: {start: [0, 1, 0]}
reserve: {agents: cf3}
transport: sim
localizer: flow
planner: straight
avoider: none
mission:
"""
UP, DOWN = "takeoff: {height: 0.8}", "land: {}"
GOTO = "goto: {by: [0, 0.1, 0]}"


def faults(*steps: str) -> list[str]:
    """The errors of a mission with these steps, each on a line of its own from the first."""
    Path("m.yaml").write_text(
        HEAD.replace("agents: cf3", "agents: [cf3]") + "".join(f"  - {step}\n" for step in steps)
    )
    try:
        load(Path("m.yaml"), Registry())
    except InputError as error:
        lines = HEAD.count("\n")
        return [
            f"{int(told.split(':')[1]) - lines} {told.split(': ', 1)[1].rpartition(' [')[0]}"
            for told in error.problems
        ]
    return []


pytestmark = pytest.mark.usefixtures("hop")


def test_a_mission_that_takes_off_flies_and_lands_has_no_fault() -> None:
    assert faults(UP, GOTO, DOWN, UP, "hold: {for: 1}", DOWN) == []


def test_an_agent_that_did_not_take_off_cannot_fly() -> None:
    assert faults(GOTO) == ["1 goto needs its agents in the air; cf1, cf2 are on the ground here"]
    assert faults("takeoff: {height: 0.8, agents: cf1}", GOTO) == [
        "2 goto needs its agents in the air; cf2 is on the ground here"
    ]


def test_an_agent_that_has_landed_cannot_fly() -> None:
    wrong = "3 goto needs its agents in the air; cf1 is on the ground here"
    assert faults(UP, "land: {agents: cf1}", GOTO) == [wrong]


def test_an_agent_that_flies_cannot_take_off() -> None:
    assert faults(UP, GOTO, UP) == [
        "3 takeoff needs its agents on the ground; cf1, cf2 are in the air here"
    ]


def test_repeated_airborne_problems_are_reported_once() -> None:
    assert len(faults(GOTO, GOTO, DOWN, UP, GOTO)) == 1


def test_an_agent_that_lands_may_stand_already() -> None:
    assert faults(UP, "land: {agents: cf1}", DOWN) == []


@pytest.mark.parametrize("wait", ["wait: {until: {elapsed: 1}}", "hold: {for: 1}"])
def test_a_wait_moves_no_agent(wait: str) -> None:
    assert faults(wait, UP, wait, GOTO) == []
    assert len(faults(wait, GOTO)) == 1


def test_the_second_round_begins_where_the_first_ends() -> None:
    hop = "repeat: {times: 2, steps: [{takeoff: {height: 0.8}}, {land: {}}]}"
    assert faults(hop) == []
    up_only = "repeat: {times: 3, steps: [{takeoff: {height: 0.8}}]}"
    assert [told[2:] for told in faults(up_only)] == [
        "takeoff needs its agents on the ground; cf1, cf2 are in the air here"
    ]
    assert faults(up_only.replace("3", "1")) == []


def test_branches_and_each_are_looked_into() -> None:
    both = (
        "parallel: [{takeoff: {agents: cf1, height: 0.8}}, {goto: {agents: cf2, by: [0, 0.1, 0]}}]"
    )
    assert [told[2:] for told in faults(both)] == [
        "goto needs its agents in the air; cf2 is on the ground here"
    ]
    each = "each: {steps: [{takeoff: {height: 0.8}}, {takeoff: {height: 0.8}}]}"
    assert len(faults(each)) == 2
    assert faults(UP, "leave: {agents: cf1}", "each: {steps: [{hold: {for: 1}}]}") == []


@pytest.mark.parametrize(
    "step",
    [
        "search: {agents: cf1, area: {low: [-1, -1], high: [1, 1]}, lane_spacing: 0.5, targets: 0}",
        "land: {until: {elapsed: 1}}",
        "land: {on_failure: continue}",
        "goto: {by: [0, 0.1, 0], on_failure: land}",
    ],
)
def test_nothing_is_reported_of_those_whose_place_is_not_known(step: str) -> None:
    assert faults(UP, step, "goto: {agents: cf1, by: [0, 0.1, 0]}") == []
    assert faults(UP, step, "takeoff: {agents: cf1, height: 0.8}") == []


def test_agents_that_left_are_in_no_later_step() -> None:
    assert faults(UP, "leave: {agents: cf1}", GOTO) == []
    assert faults(UP, "leave: {agents: cf1}", "hold: {agents: cf1, for: 1}") == [
        "3 hold has no agents: cf1 left the mission before"
    ]


def test_a_reserve_flies_when_it_has_joined() -> None:
    assert faults(UP, "join: {agents: cf3, height: 0.8}", GOTO, DOWN) == []
    assert faults(UP, "join: {agents: cf3, height: 0.8}", UP) == [
        "3 takeoff needs its agents on the ground; cf1, cf2, cf3 are in the air here"
    ]


def test_agents_starting_above_the_floor_are_not_checked() -> None:
    Path("m.yaml").write_text(
        HEAD.replace("reserve: {agents: cf3}\n", "")
        .replace(", 0, 0]", ", 0, 0.3]")
        .replace("1, 0]}", "1, 0.3]}")
        + f"  - {GOTO}\n"
    )
    load(Path("m.yaml"), Registry())
