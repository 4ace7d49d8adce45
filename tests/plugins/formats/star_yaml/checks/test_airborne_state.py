"""Steps that need agents in the air, or on the ground, and find them elsewhere."""

from __future__ import annotations

import pytest

from tests.plugins.formats.star_yaml.problems import of_steps

HEAD = """\
star: 1
name: m
world: room.yaml
swarm:
  cf1: {start: [-0.5, 0, 0], camera: aideck}
  cf2: {start: [0.5, 0, 0]}
  cf3: {start: [0, 1, 0]}
reserve: {agents: [cf3]}
transport: sim
localizer: flow
planner: straight
avoider: none
mission:
"""
UP, DOWN, HOLD = "takeoff: {height: 0.8}", "land: {}", "hold: {for: 1}"
GOTO = "goto: {by: [0, 0.1, 0]}"
ONE_UP, ONE_DOWN = "takeoff: {agents: cf1, height: 0.8}", "land: {agents: cf1}"
ONE_GOES, ONE_LEAVES = "goto: {agents: cf1, by: [0, 0.1, 0]}", "leave: {agents: cf1}"
JOIN = "join: {agents: cf3, height: 0.8}"

pytestmark = pytest.mark.usefixtures("hop")


@pytest.mark.parametrize(
    "steps",
    [
        [UP, GOTO, DOWN, UP, HOLD, DOWN],
        [UP, ONE_DOWN, DOWN],  # an agent that lands may stand already
        ["wait: {until: {elapsed: 1}}", UP, HOLD, GOTO],
        ["repeat: {times: 2, steps: [{takeoff: {height: 0.8}}, {land: {}}]}"],
        ["repeat: {times: 1, steps: [{takeoff: {height: 0.8}}]}"],
        [UP, ONE_LEAVES, "each: {steps: [{hold: {for: 1}}]}"],
        [UP, ONE_LEAVES, GOTO],
        [UP, JOIN, GOTO, DOWN],
    ],
)
def test_agents_may_be_where_their_steps_need_them(steps: list[str]) -> None:
    assert of_steps(HEAD, steps) == []


@pytest.mark.parametrize(
    ("steps", "position"),
    [
        ([GOTO], "1:5"),
        ([ONE_UP, GOTO], "2:5"),
        ([UP, ONE_DOWN, GOTO], "3:5"),
        ([UP, GOTO, UP], "3:5"),
        ([GOTO, GOTO, DOWN, UP, GOTO], "1:5"),  # which is reported once
        ([HOLD, GOTO], "2:5"),
        (["wait: {until: {elapsed: 1}}", GOTO], "2:5"),
        (["repeat: {times: 3, steps: [{takeoff: {height: 0.8}}]}"], "1:32"),  # the second round
        (["parallel: [{takeoff: {agents: cf1}}, {goto: {agents: cf2, by: [0, 0.1, 0]}}]"], "1:42"),
        ([UP, JOIN, UP], "3:5"),
    ],
)
def test_agents_cannot_be_where_steps_do_not_need_them(steps: list[str], position: str) -> None:
    assert of_steps(HEAD, steps) == [f"step {position} [wrong-airborne-state]"]


def test_steps_of_each_agent_are_looked_into() -> None:
    each = "each: {steps: [{takeoff: {height: 0.8}}, {takeoff: {height: 0.8}}]}"
    assert of_steps(HEAD, [each]) == ["step 1:46 [wrong-airborne-state]"] * 2


@pytest.mark.parametrize(
    "step",
    [
        "search: {agents: cf1, area: {low: [-1, -1], high: [1, 1]}, lane_spacing: 0.5, targets: 0}",
        "land: {until: {elapsed: 1}}",
        "land: {on_failure: continue}",
        "goto: {by: [0, 0.1, 0], on_failure: land}",
    ],
)
def test_nothing_is_reported_of_agents_in_unknown_states(step: str) -> None:
    assert of_steps(HEAD, [UP, step, ONE_GOES]) == []
    assert of_steps(HEAD, [UP, step, ONE_UP]) == []


def test_agents_that_left_are_in_no_later_step() -> None:
    steps = [UP, ONE_LEAVES, "hold: {agents: cf1, for: 1}"]
    assert of_steps(HEAD, steps) == ["step 3:5 [agent-not-in-mission]"]


def test_agents_starting_above_the_floor_are_not_checked() -> None:
    high = HEAD.replace("reserve: {agents: [cf3]}\n", "").replace(", 0]", ", 0.3]")
    assert of_steps(high, [GOTO]) == []
