"""How agents of a rehearsal are steered among obstacles, and relieved."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

from star_core import AgentPhase, PlannerSpec, PluginError, hookimpl
from tests.plugins.commands.star_explain.conftest import HALL, Rehearse

WORLD = HALL + "obstacles: {block: {box: {centre: [1.5, 0], size: [1, 1]}, height: [0, 3]}}\n"
MISSION = """\
star: 1
name: past
world: hall.yaml
swarm: {a: {start: [0, 0, 0]}, b: {start: [0, 3, 0]}}
transport: sim
localizer: flow
planner: visibility
avoider: orca
mission:
  - takeoff: {agents: a, height: 0.8}
  - goto: {agents: a, to: [3, 0, 0.8]}
  - land: {agents: a}
"""
LOW = ("reserve={agents: [b], relieve_below: 3.4}", "transport.endurance=10")


class Broken:
    """A planner that fails in flight."""

    def __init__(self, _scene: Any) -> None: ...

    def plan(self, _estimate: Any, _goals: Any) -> Any:
        raise ZeroDivisionError

    @staticmethod
    @hookimpl
    def star_planners() -> Iterator[PlannerSpec]:
        yield PlannerSpec(name="broken", summary="Fails.", make=Broken, avoids_obstacles=True)


@pytest.fixture
def rehearsed(rehearse: Rehearse) -> Rehearse:
    return partial(rehearse, MISSION, world=WORLD, plugins=(Broken,))


def test_the_planner_leads_around_obstacles(rehearsed: Rehearse) -> None:
    around, straight = rehearsed(), rehearsed("planner=straight")
    assert abs(around.position[:, 0, 1]).max() > 0.65  # m: half the block, and most of a clearance
    assert abs(straight.position[:, 0, 1]).max() < 0.01
    assert around.time[-1] > straight.time[-1]


def test_a_planner_that_cannot_be_made_is_named(
    rehearsed: Rehearse, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raises(_self: Broken, _scene: Any) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(Broken, "__init__", raises)
    with pytest.raises(PluginError, match=r"planner 'broken' \(.*\): ZeroDivisionError"):
        rehearsed("planner=broken")


def test_agents_turn_at_the_yaw_rate_of_the_planner(rehearsed: Rehearse) -> None:
    rehearsal = rehearsed(
        "planner={use: straight, yaw_rate_deg: 45}",
        "mission.1.goto={agents: a, to: [0, -2, 0.8], yaw_deg: 90}",
    )
    turn = np.abs(np.diff(rehearsal.yaw[:, 0])) / np.diff(rehearsal.time)
    assert np.rad2deg(turn.max()) == pytest.approx(45)
    assert np.rad2deg(rehearsal.yaw[-1, 0]) == pytest.approx(90)


def test_agents_fly_straight_once_a_planner_fails(rehearsed: Rehearse) -> None:
    rehearsal = rehearsed("planner=broken")
    assert abs(rehearsal.position[:, 0, 1]).max() < 0.01
    assert {step.outcome for step in rehearsal.steps} == {"done"}


def test_reserves_relieve_agents_in_a_rehearsal(rehearsed: Rehearse) -> None:
    flies = rehearsed("planner=straight", *LOW).phase == AgentPhase.FLYING
    assert flies.any(axis=0).tolist() == [True, True]
    assert not (rehearsed("planner=straight").phase[:, 1] == AgentPhase.FLYING).any()
