"""The verb ``takeoff``."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import AgentPhase, Order, Status
from star_core.testing import scene
from tests.plugins.tasks.conftest import fly, make

GROUND = [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]


def test_agents_climb_to_the_height_and_hold_there() -> None:
    room = scene(2)
    flown = fly(make("takeoff", room, (0, 1)), room, GROUND, phase=AgentPhase.GROUNDED)
    assert flown.status is Status.SUCCESS
    assert flown.end[:, 2] == pytest.approx([0.8, 0.8])
    assert flown.goals[-1].position.tolist() == [[-0.5, 0.0, 0.8], [0.5, 0.0, 0.8]]


@pytest.mark.parametrize(
    ("height", "speed", "seconds"), [(1.2, 0.4, 3.0), (0.3, 0.5, 1.0)], ids=["", "the shortest"]
)
def test_the_commanders_receive_one_command_with_its_duration(
    height: float, speed: float, seconds: float
) -> None:
    room = scene(2)
    task = make("takeoff", room, (0, 1), height=height, speed=speed)
    (command,) = fly(task, room, GROUND, phase=AgentPhase.GROUNDED).commands
    assert command.order is Order.TAKEOFF
    assert command.position[:, 2].tolist() == [height, height]
    assert command.duration == pytest.approx([seconds, seconds])


def test_an_agent_that_is_in_the_air_already_is_named() -> None:
    room = scene(2)
    flown = fly(make("takeoff", room, (0, 1)), room, GROUND, phase=AgentPhase.FLYING)
    assert flown.status is Status.FAILURE
    assert flown.reason == "already in the air: cf1, cf2"
    assert flown.commands == []


def test_it_waits_until_all_are_located() -> None:
    room = scene(2)
    flown = fly(
        make("takeoff", room, (0, 1)),
        room,
        GROUND,
        phase=AgentPhase.GROUNDED,
        located=lambda time: np.array([True, time >= 2.0]),
    )
    assert flown.status is Status.SUCCESS
    assert flown.goals[39] is None
    assert flown.goals[40] is not None


def test_agents_that_end_far_from_the_height_did_not_take_off() -> None:
    room = scene(1)
    task = make("takeoff", room, (0,))
    flown = fly(
        task,
        room,
        [[0.0, 0.0, 0.0]],
        phase=AgentPhase.GROUNDED,
        located=lambda time: np.array([time < 1.0]),
        longest=20.0,
    )
    assert flown.status is Status.RUNNING


def test_a_take_off_may_take_three_times_its_climb_and_5_s() -> None:
    room = scene(2)
    task = make("takeoff", room, (0, 1), height=0.9)
    assert fly(task, room, GROUND, longest=0.0).limit == pytest.approx(3 * 3.0 + 5)
