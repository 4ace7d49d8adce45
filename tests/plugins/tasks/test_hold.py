"""The verb ``hold``."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import Status
from star_core.testing import scene

AIR = [[-0.5, 0.0, 0.8], [0.5, 0.0, 0.8]]


def test_agents_stay_where_they_are_for_the_time(make: Any, fly: Any) -> None:
    room = scene(2)
    flown = fly(make("hold", room, (0, 1), **{"for": 3.0}), room, AIR)
    assert flown.status is Status.SUCCESS
    assert flown.time == pytest.approx(3.0)
    assert flown.end.tolist() == AIR


def test_a_hold_without_a_time_is_over_at_once(make: Any, fly: Any) -> None:
    room = scene(2)
    flown = fly(make("hold", room, (0, 1)), room, AIR)
    assert (flown.status, flown.time) == (Status.SUCCESS, 0.0)


def test_the_time_counts_from_arrival(make: Any, fly: Any) -> None:
    room = scene(1)
    there = fly(make("goto", room, (0,), to=[2.0, 0.0, 1.0]), room, AIR[:1])
    flown = fly(make("hold", room, (0,), at=[2.0, 0.0, 1.0], **{"for": 3.0}), room, AIR[:1])
    assert flown.time == pytest.approx(there.time + 3.0)


def test_the_time_does_not_begin_before_all_are_located(make: Any, fly: Any) -> None:
    room = scene(1)
    task = make("hold", room, (0,), **{"for": 1.0})
    flown = fly(task, room, AIR[:1], located=lambda time: np.array([time >= 2.0]))
    assert flown.time == pytest.approx(3.0)


def test_a_hold_may_take_three_times_its_time_and_5_s(make: Any, fly: Any) -> None:
    room = scene(1)
    assert fly(make("hold", room, (0,), **{"for": 4.0}), room, AIR[:1]).limit == 17.0


def test_agents_already_outside_the_fence_may_hold(make: Any, fly: Any) -> None:
    room = scene(1)
    assert fly(make("hold", room, (0,)), room, [[11.0, 0.0, 0.8]]).status is Status.SUCCESS


def test_positions_of_the_remaining_agents_are_checked(make: Any, fly: Any) -> None:
    room = scene(1)
    flown = fly(make("hold", room, (0,), at=[11.0, 0.0, 0.8]), room, AIR[:1])
    assert flown.status is Status.FAILURE
    assert flown.reason.startswith("cf1 cannot be there: [11, 0, 0.8] is outside the fence")


def test_a_point_that_cannot_be_held_is_a_problem(problems: Any) -> None:
    low = replace(scene(1).limits, height=(0.5, 1.0))
    room = replace(scene(1), limits=low)
    ((path, message),) = problems("hold", room, (0,), at=[0.0, 0.0, 0.2])
    assert path == ("at",)
    assert message == "[0, 0, 0.2] is outside the heights to fly at, from 0.5 to 1 m"
