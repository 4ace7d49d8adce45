"""The verb ``land``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from star_core import AgentPhase, Order, Status
from star_core.testing import estimate, health, scene
from tests.plugins.tasks.conftest import fly, make

AIR = [[-0.5, 0.0, 0.8], [0.5, 0.0, 1.2]]


def test_agents_descend_in_place_to_the_floor() -> None:
    room = scene(2)
    flown = fly(make("land", room, (0, 1)), room, AIR)
    assert flown.status is Status.SUCCESS
    assert flown.end.tolist() == [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("start", "seconds"), [(AIR, [2.0, 3.0]), ([[0.0, 0.0, 0.1], [1.0, 0.0, 0.3]], [1.0, 1.0])]
)
def test_each_descends_at_the_speed_and_for_a_second_at_least(
    start: list[list[float]], seconds: list[float]
) -> None:
    room = scene(2)
    (command,) = fly(make("land", room, (0, 1), speed=0.4), room, start).commands
    assert command.order is Order.LAND
    assert command.duration == pytest.approx(seconds)


@pytest.mark.parametrize("phase", [AgentPhase.GROUNDED, AgentPhase.LANDED])
def test_agents_on_the_ground_get_no_command(phase: AgentPhase) -> None:
    room = scene(2)
    flown = fly(make("land", room, (0, 1)), room, AIR, phase=phase)
    assert flown.status is Status.SUCCESS
    assert flown.commands == []


def test_an_agent_that_lands_already_gets_no_second_order() -> None:
    room = scene(2)
    task = make("land", room, (0, 1))
    flown = fly(task, room, AIR, phase=AgentPhase.LANDING, longest=1.0)
    assert flown.status is Status.RUNNING
    assert flown.commands == []


def test_a_replacement_of_a_landing_agent_lands_too() -> None:
    room = scene(3)
    task, now = make("land", room, (0, 1)), estimate(np.full((3, 3), 0.8))
    task.begin(now, health(3))
    task.step(now, health(3))
    task.on_agent_replaced(1, 2)
    phase = np.array([AgentPhase.LANDING, AgentPhase.LANDING, AgentPhase.FLYING])
    (command,) = task.step(now, replace(health(3), phase=phase)).commands
    assert command.agent.tolist() == [2]


def test_unlocated_agents_descend_as_from_the_greatest_height() -> None:
    room = scene(2)
    task = make("land", room, (0, 1))
    flown = fly(task, room, AIR, located=lambda _: np.array([True, False]))
    assert flown.status is Status.SUCCESS
    assert flown.commands[0].duration == pytest.approx([4.0, 9.0])
    assert np.isfinite(flown.commands[0].position).all()


def test_a_landing_may_take_three_times_its_descent_and_5_s() -> None:
    room = scene(2)
    assert fly(make("land", room, (0, 1)), room, AIR).limit == pytest.approx(3 * 6.0 + 5)
