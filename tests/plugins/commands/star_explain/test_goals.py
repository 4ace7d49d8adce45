"""Warnings of goals that only the rehearsal knows; what certainly fails is in tests/corpus."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TypeAlias

import pytest

from star_core.formats import code_of
from tests.plugins.commands.star_explain.conftest import Warn

Steps: TypeAlias = Callable[..., list[str]]

WORLD = "star: 1\nname: hall\nfence: {low: [-2, -2, 0], high: [2, 2, 2.2]}\n"
MISSION = """\
star: 1
name: hops
world: hall.yaml
swarm:
  cf1: {start: [0, 0, 0]}
  cf2: {start: [1.2, 0, 0]}
transport: {use: sim, noise: false}
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {height: 0.8}
"""


@pytest.fixture
def warnings(warn: Warn) -> Steps:
    """Return line and code of each warning of a mission with some steps after a take-off."""

    def warned(*steps: str) -> list[str]:
        text = MISSION + "".join(f"  - {step}\n" for step in steps)
        return [
            f"{warning.split(':')[1]} {code_of(warning)}" for warning in warn(text, world=WORLD)
        ]

    return warned


@pytest.mark.parametrize(
    "step",
    [
        "goto: {agents: cf1, by: [1.95, 1, 0]}",  # within the error of a position
        "goto: {agents: cf1, by: [3, 0, 0], until: {elapsed: 2}}",
        "goto: {agents: cf1, by: [3, 0, 0], on_failure: continue}",
    ],
)
def test_offsets_that_may_fail_are_warned_of(warnings: Steps, step: str) -> None:
    assert warnings("goto: {agents: cf1, by: [1.8, 0, 0]}") == []
    assert warnings(step) == ["13 unreachable-goal"]


def test_an_offset_from_a_named_goal_is_exact(warnings: Steps) -> None:
    named = "goto: {agents: cf1, to: [1, 1, 0.8]}"
    assert warnings(named, "goto: {agents: cf1, by: [0.95, 0, 0]}") == []


def test_an_offset_from_another_agent_is_not_exact(warnings: Steps) -> None:
    named = "goto: {agents: cf1, to: [0.5, 1, 0.8]}", "goto: {agents: cf2, to: [1, -1, 0.8]}"
    beside = "goto: {agents: cf1, relative_to: cf2, by: [%g, 2, 0], moving: true}"
    assert warnings(*named, beside % 0.85) == []
    assert warnings(*named, beside % 0.95) == ["15 unreachable-goal"]


def test_an_offset_from_an_uncertain_position_is_warned_of(warnings: Steps) -> None:
    ended = "goto: {agents: cf1, to: [1, 1, 0.8], until: {elapsed: 1}}"
    offset = "goto: {agents: cf1, by: [0, -3.5, 0]}"
    assert warnings(ended, offset) == ["14 unreachable-goal"]
    waypoint = "goto: {agents: cf1, to: [-1, 1, 0.8]}"
    assert warnings(ended, waypoint, "goto: {agents: cf1, by: [0, -2, 0]}") == []


def test_a_step_that_times_out_in_the_rehearsal_is_warned_of(warnings: Steps) -> None:
    grounded = "land: {on_failure: continue}"  # so that the goal after it is not reached
    assert warnings(grounded, "goto: {to: [0, 1, 1]}")[-1] == "14 timeout-too-short"


def test_goals_too_near_to_another_agent_are_warned_of(warnings: Steps) -> None:
    assert warnings("goto: {agents: cf1, to: [1.1, 0, 0.8]}") == ["13 too-close"]
    assert warnings("goto: {agents: cf1, to: [0.95, 0, 0.8]}") == ["13 too-close"]
    assert warnings("goto: {agents: cf1, to: [0.85, 0, 0.8]}") == []
    above = "goto: {agents: cf1, to: [1.2, 0, 1.7]}"
    assert warnings(above) == []
    landed = "land: {agents: cf2}"
    low = "goto: {agents: cf1, to: [1.1, 0, 0.4]}"
    assert warnings(landed, low) == ["14 too-close"]
    assert warnings("leave: {agents: cf2}", low) == []


def test_agents_that_swap_positions_at_once_are_not_warned_of(warnings: Steps) -> None:
    east, west = ({"agents": f"cf{i}", "by": [by, 0, 0]} for i, by in ((1, 1.2), (2, -1.2)))
    swap = json.dumps({"parallel": [{"goto": east}, {"goto": west}]})
    assert warnings(swap) == []
