"""The verb ``hold``."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Status
from star_core.testing import scene
from tests.plugins.tasks.conftest import fly, make

AIR = [[-0.5, 0.0, 0.8], [0.5, 0.0, 0.8]]


@pytest.mark.parametrize(("options", "seconds"), [({"for": 3.0}, 3.0), ({}, 0.0)])
def test_agents_stay_where_they_are_for_the_time(options: dict[str, float], seconds: float) -> None:
    room = scene(2)
    flown = fly(make("hold", room, (0, 1), **options), room, AIR)
    assert flown.status is Status.SUCCESS
    assert flown.time == pytest.approx(seconds)
    assert flown.end.tolist() == AIR


def test_the_time_counts_from_arrival() -> None:
    room = scene(1)
    journey = fly(make("goto", room, (0,), to=[2.0, 0.0, 1.0]), room, AIR[:1])
    flown = fly(make("hold", room, (0,), at=[2.0, 0.0, 1.0], **{"for": 3.0}), room, AIR[:1])
    assert flown.time == pytest.approx(journey.time + 3.0)


def test_the_time_does_not_begin_before_all_are_located() -> None:
    room = scene(1)
    task = make("hold", room, (0,), **{"for": 1.0})
    flown = fly(task, room, AIR[:1], located=lambda time: np.array([time >= 2.0]))
    assert flown.time == pytest.approx(3.0)


def test_a_hold_may_take_three_times_its_time_and_5_s() -> None:
    room = scene(1)
    assert fly(make("hold", room, (0,), **{"for": 4.0}), room, AIR[:1]).limit == 17.0


def test_agents_already_outside_the_fence_may_hold() -> None:
    room = scene(1)
    assert fly(make("hold", room, (0,)), room, [[11.0, 0.0, 0.8]]).status is Status.SUCCESS


def test_positions_of_the_remaining_agents_are_checked() -> None:
    room = scene(1)
    flown = fly(make("hold", room, (0,), at=[11.0, 0.0, 0.8]), room, AIR[:1])
    assert flown.status is Status.FAILURE
    assert flown.reason.startswith("cf1 cannot be there: [11, 0, 0.8] is outside the fence")
