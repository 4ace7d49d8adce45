"""Agents that hover in the way of others, for avoiders that may not lead around them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from star_core import Registry, load
from star_explain.parked import parked_problems
from tests.plugins.commands.star_explain.conftest import HALL, Warn

BESIDE = ("swarm.cf3.start=[3, 0.6, 0]", "swarm.cf4.start=[3, -0.6, 0]")
MISSION = """\
star: 1
name: passing
world: hall.yaml
swarm:
  cf1: {start: [0, 0, 0]}
  cf2: {start: [1.5, 0, 0]}
transport: {use: sim, profile: ideal, controller: ideal, noise: false}
localizer: flow
planner: straight
avoider: potential
mission:
  - takeoff: {height: 0.8}
  - goto: {agents: cf1, to: [3, 0, 0.8]}
  - land: {}
"""


@pytest.mark.parametrize(
    ("changes", "is_warned"),
    [
        (["avoider=voronoi"], False),
        (["avoider=voronoi", *BESIDE], True),  # its goal is between two that hover
        (["avoider=potential"], True),
        (["avoider=orca"], False),
        (["avoider=none"], False),
        (["swarm.cf2.start=[1.5, 0.6, 0]"], False),
        (["mission.1.goto.agents=cf2"], False),
    ],
)
def test_a_hovering_agent_in_the_way_is_warned_of(
    warn: Warn, changes: list[str], *, is_warned: bool
) -> None:
    warnings = warn(MISSION, *changes)
    assert ["[agent-in-the-way]" in text for text in warnings] == [True] * is_warned


@pytest.mark.parametrize(("seconds", "is_warned"), [(15.0, True), (5.0, False)])
def test_an_agent_that_creeps_before_another_is_warned_of(
    tmp_path: Path, seconds: float, *, is_warned: bool
) -> None:
    (tmp_path / "hall.yaml").write_text(HALL)
    (tmp_path / "passing.yaml").write_text(MISSION)
    mission = load(tmp_path / "passing.yaml", Registry())
    time = np.arange(0.0, 20.0, 0.5)
    position = np.full((len(time), 2, 3), 0.8)
    position[:, 0, 0], position[:, 1, 0] = 0.9 + 0.02 * np.minimum(time, seconds), 1.5  # m
    tables = time, position, np.zeros((len(time), 2)), np.ones((len(time), 2), np.bool_)
    rehearsal: Any = SimpleNamespace(sampled=lambda _period: tables)
    problems = [*parked_problems(mission, Registry(), rehearsal)]
    assert [problem.code for problem in problems] == ["agent-in-the-way"] * is_warned
