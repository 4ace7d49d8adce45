"""Who has a goal and gets no nearer to it."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from star_core import AgentPhase, Goals, Paths, Tick
from star_core.deadlock import Deadlocks

Track = Callable[[float], float]
NO_PATHS = Paths(np.zeros(0, np.int64), np.zeros((0, 3)))


def deadlocks(
    x: Track,
    seconds: float,
    goal: Track = lambda _time: 5.0,
    *,
    phase: AgentPhase = AgentPhase.FLYING,
    active: bool = True,
    paths: Paths = NO_PATHS,
) -> int:
    """How often an agent at `x` that is to fly to `goal`, both on one axis, is in a deadlock."""
    found = Deadlocks(1)
    for time in np.arange(0.0, seconds, 0.05):
        goals = Goals(
            np.array([[goal(time), 0.0, 0.0]]),
            np.zeros((1, 3)),
            np.zeros(1),
            np.ones(1),
            np.array([active]),
        )
        tick = SimpleNamespace(
            time=float(time),
            goals=goals,
            health=SimpleNamespace(phase=np.array([int(phase)])),
            estimate=SimpleNamespace(position=np.array([[x(time), 0.0, 0.0]])),
            plan=SimpleNamespace(paths=paths),
        )
        found.add(cast("Tick", tick))
    return found.count


def test_who_stands_far_from_its_goal_is_in_one_deadlock_however_long() -> None:
    assert deadlocks(lambda _time: 1.0, 4.9) == 0
    assert deadlocks(lambda _time: 1.0, 60.0) == 1


def test_who_dances_on_the_spot_is_in_a_deadlock() -> None:
    assert deadlocks(lambda time: 1.0 + 0.5 * np.sin(4 * time), 20.0) == 1


def test_who_gets_on_slowly_is_in_none() -> None:
    assert deadlocks(lambda time: 0.02 * time, 60.0) == 0


def test_who_gets_on_again_and_is_stuck_again_is_in_two() -> None:
    def steps(time: float) -> float:
        return 1.0 if time < 10 else min(2.0, time - 9.0)

    assert deadlocks(steps, 30.0) == 2


def test_who_has_arrived_is_in_none() -> None:
    assert deadlocks(lambda _time: 4.8, 60.0) == 0


def test_who_has_no_goal_or_does_not_fly_is_in_none() -> None:
    assert deadlocks(lambda _time: 1.0, 60.0, active=False) == 0
    assert deadlocks(lambda _time: 1.0, 60.0, phase=AgentPhase.LANDED) == 0


def test_who_follows_a_goal_that_moves_is_in_none() -> None:
    assert deadlocks(lambda _time: 1.0, 60.0, lambda time: 5.0 + 0.1 * time) == 0


def test_a_way_round_counts_by_what_is_left_of_it() -> None:
    ahead: list[Any] = [[0.0, 3.0, 0.0], [5.0, 0.0, 0.0]]
    round_ = Paths(np.array([0, 0]), np.array(ahead))
    assert deadlocks(lambda time: 4.8 - 0.05 * time, 20.0) == 1  # it flies away from its goal
    assert deadlocks(lambda time: 4.8 - 0.05 * time, 20.0, paths=round_) == 0  # on a way round it
