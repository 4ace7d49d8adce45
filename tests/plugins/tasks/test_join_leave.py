"""The verbs ``join`` and ``leave``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import (
    AgentPhase,
    Order,
    Registry,
    Scene,
    Status,
    Telemetry,
    TransportSpec,
    hookimpl,
    load,
)
from star_core import fly as fly_mission
from star_core.testing import estimate, health, scene
from star_sim import ideal_world
from star_sim.transport import Simulator
from tests.plugins.mission_files import write_mission
from tests.plugins.tasks.conftest import fly, make

GROUND = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
GROUNDED = AgentPhase.GROUNDED


def joins(where: Any = GROUND, volt: float = 4.1, second: AgentPhase = AgentPhase.GROUNDED) -> Any:
    """Output of the first agent's join."""
    task = make("join", scene(3), (0,), battery=3.8)
    phase = np.array([GROUNDED, second, GROUNDED])
    well = replace(health(3, GROUNDED), phase=phase, battery=np.array([volt, 4.0, 4.0]))
    task.begin(estimate(GROUND), well)
    return task.step(estimate(np.array(where)), well)


def test_an_agent_that_is_fit_takes_off() -> None:
    step = joins()
    (command,) = step.commands
    assert (command.order, command.agent.tolist()) == (Order.TAKEOFF, [0])
    assert step.status is Status.RUNNING


@pytest.mark.parametrize(("volt", "shown"), [(3.7, "3.70"), (np.nan, "nan")])
def test_agents_with_low_or_unknown_battery_do_not_join(volt: float, shown: str) -> None:
    step = joins(volt=volt)
    assert step.status is Status.FAILURE
    assert step.reason == f"the battery of cf1 is at {shown} V, 3.8 V needed"


def test_an_agent_that_is_not_located_stays_down_until_it_is() -> None:
    task = make("join", scene(3), (0,), battery=3.8)
    well = replace(health(3, GROUNDED), battery=np.full(3, 4.1))
    task.begin(estimate(GROUND), well)
    lost = replace(estimate(GROUND), valid=np.array([False, True, True]))
    for _ in range(3):
        step = task.step(lost, well)
        assert (step.status, step.commands) == (Status.RUNNING, ())
    assert task.step(estimate(GROUND), well).commands[0].order is Order.TAKEOFF


class Deaf(Simulator):
    """A simulator that hears nothing of its second drone."""

    def receive(self) -> Telemetry:
        telemetry = super().receive()
        age, battery = telemetry.age.copy(), telemetry.battery.copy()
        age[1], battery[1] = 9.0, np.nan
        return replace(telemetry, age=age, battery=battery)


class Deafness:
    """A plugin that offers the transport ``deaf``."""

    @hookimpl
    def star_transports(self) -> list[TransportSpec]:
        def make(scene: Scene) -> Deaf:
            return Deaf(scene, **ideal_world())

        return [TransportSpec(name="deaf", summary="Hears one.", make=make, realtime=False)]


def test_unheard_agents_do_not_join_and_the_others_land(tmp_path: Path) -> None:
    steps = "  - takeoff: {height: 0.5}\n  - join: {agents: cf2, height: 0.5}\n"
    mission = write_mission(tmp_path, steps, reserve="{agents: [cf2]}", transport="deaf")
    registry = Registry(Deafness())
    summary = fly_mission(load(mission, registry), registry)
    assert summary["outcome"] == "failed"
    assert "cf2" in summary["reason"]
    assert summary["path_length_m"]["per_agent"]["cf2"] < 0.05


@pytest.mark.parametrize("height", [0.2, 1.0])
@pytest.mark.parametrize("phase", [AgentPhase.FLYING, AgentPhase.LANDING, AgentPhase.LOST])
def test_no_agent_takes_off_under_another(height: float, phase: AgentPhase) -> None:
    step = joins([[-1.0, 0.0, 0.0], [-0.8, 0.0, height], [1.0, 0.0, 0.0]], second=phase)
    assert (step.status, step.reason) == (Status.FAILURE, "cf2 is above cf1")


def test_an_agent_on_the_ground_keeps_no_other_from_joining() -> None:
    step = joins([[-1.0, 0.0, 0.0], [-0.8, 0.0, 0.05], [1.0, 0.0, 0.0]])
    assert step.commands[0].order is Order.TAKEOFF


def test_no_agent_joins_under_another_as_it_is_located() -> None:
    task = make("join", scene(3), (0,), battery=3.8)
    well = replace(health(3, GROUNDED), battery=np.full(3, 4.1))
    well = replace(well, phase=np.array([GROUNDED, AgentPhase.FLYING, GROUNDED]))
    task.begin(estimate(GROUND), well)
    under = estimate(np.array([[-1.0, 0.0, 0.0], [-0.8, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    position = under.position.copy()
    position[0] = np.nan
    lost = replace(under, position=position, valid=np.array([False, True, True]))
    assert task.step(lost, well).status is Status.RUNNING
    assert task.step(under, well).reason == "cf2 is above cf1"


def test_an_agent_that_leaves_flies_home_and_lands_there() -> None:
    room = scene(3)  # they start 1 m apart on a line
    away = [[0.0, 2.0, 1.1], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0]]
    flown = fly(make("leave", room, (0,)), room, away)
    assert flown.status is Status.SUCCESS
    assert flown.end[0] == pytest.approx([-1.0, 0.0, 0.0], abs=0.1)
    (command,) = flown.commands
    assert command.order is Order.LAND
    high = flown.track[:-1, 0, 2]
    distant = np.hypot(*(flown.track[:-1, 0, :2] - [-1.0, 0.0]).T) > 0.2
    assert high[distant] == pytest.approx(1.1, abs=0.05)


def test_the_timeout_of_leave_covers_flight_and_descent() -> None:
    room = scene(1)
    flown = fly(make("leave", room, (0,), speed=0.3), room, [[3.0, 0.0, 1.0]])
    assert flown.time < flown.limit


def lands(*away: float, ticks: int = 60) -> bool:
    """Whether a leave lands an agent that is so far from its home, m, tick after tick."""
    task = make("leave", scene(1), (0,))
    for tick in range(ticks):
        now = estimate(np.array([[away[min(tick, len(away) - 1)], 0.0, 1.0]]), time=tick / 20)
        if tick == 0:
            task.begin(now, health(1))
        if task.step(now, health(1)).commands:
            return True
    return False


def test_an_agent_that_is_kept_from_its_home_lands_near_it_only() -> None:
    assert lands(0.3)
    assert not lands(0.3, ticks=40)
    assert not lands(0.6)


def test_agents_still_approaching_home_do_not_land_yet() -> None:
    slowly = np.linspace(0.5, 0.15, 100)  # 7 cm a second
    assert not lands(*slowly, ticks=100)
