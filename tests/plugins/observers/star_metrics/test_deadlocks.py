"""Agents that have a goal and get no nearer to it."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from star_core import AgentPhase, Goals, Paths, Tick
from star_core.toolkit import Pairs
from star_metrics.deadlocks import WAITING_DISTANCE, Deadlocks, waiting

Track = Callable[[float], float]
NO_PATHS = Paths(np.zeros(0, np.int64), np.zeros((0, 3)))


def flown(
    tracks: list[tuple[Track, Track]],
    seconds: float,
    *,
    phase: AgentPhase = AgentPhase.FLYING,
    active: bool = True,
    paths: Paths = NO_PATHS,
) -> Deadlocks:
    """What is counted of agents that are somewhere and want to go somewhere, all on one axis."""
    n = len(tracks)
    counter = Deadlocks(n)
    for time in np.arange(0.0, seconds, 0.05):
        position, goal = np.zeros((n, 3)), np.zeros((n, 3))
        position[:, 0] = [at(time) for at, _ in tracks]
        goal[:, 0] = [to(time) for _, to in tracks]
        goals = Goals(goal, np.zeros((n, 3)), np.zeros(n), np.ones(n), np.full(n, active))
        setpoint = SimpleNamespace(velocity=np.sign(goal - position))
        tick = SimpleNamespace(
            time=float(time),
            goals=goals,
            health=SimpleNamespace(phase=np.full(n, int(phase))),
            estimate=SimpleNamespace(position=position),
            plan=SimpleNamespace(paths=paths, setpoint=setpoint),
        )
        counter.add(cast("Tick", tick))
    return counter


def deadlocks(x: Track, seconds: float, goal: Track = lambda _time: 5.0, **options: Any) -> int:
    """Return how often a lone agent at `x` on its way to `goal` is in a deadlock."""
    counter = flown([(x, goal)], seconds, **options)
    assert counter.waits == counter.count  # an agent that waits, waits for none
    return counter.count


def stands(x: float, goal: float) -> tuple[Track, Track]:
    return lambda _time: x, lambda _time: goal


def crawls(x: float, goal: float) -> tuple[Track, Track]:
    return lambda time: x + 0.02 * time, lambda _time: goal


def test_a_stop_far_from_the_goal_is_one_deadlock_of_any_length() -> None:
    assert deadlocks(lambda _time: 1.0, 4.9) == 0
    assert deadlocks(lambda _time: 1.0, 60.0) == 1


def test_an_agent_that_dances_on_the_spot_is_in_a_deadlock() -> None:
    assert deadlocks(lambda time: 1.0 + 0.5 * np.sin(4 * time), 20.0) == 1


def test_agents_returning_after_making_room_wait_until_they_stop() -> None:
    def aside(stop: float) -> Track:
        """From 4 m back to 1 m, and forth again until `stop`."""
        return lambda time: max(4.0 - time, 0.5 * min(time, stop) - 0.5)

    on_its_way = flown([(aside(20.0), lambda _time: 5.0)], 12.0)
    assert (on_its_way.waits, on_its_way.count) == (1, 0)
    assert flown([(aside(6.0), lambda _time: 5.0)], 12.0).count == 1


def test_an_agent_that_gets_on_slowly_is_in_none() -> None:
    assert deadlocks(lambda time: 0.02 * time, 60.0) == 0


def test_getting_stuck_again_counts_as_a_second_deadlock() -> None:
    def steps(time: float) -> float:
        return 1.0 if time < 10 else min(2.0, time - 9.0)

    assert deadlocks(steps, 30.0) == 2


def test_an_agent_that_has_arrived_is_in_none() -> None:
    assert deadlocks(lambda _time: 4.8, 60.0) == 0


def test_an_agent_that_has_no_goal_or_does_not_fly_is_in_none() -> None:
    assert deadlocks(lambda _time: 1.0, 60.0, active=False) == 0
    assert deadlocks(lambda _time: 1.0, 60.0, phase=AgentPhase.LANDED) == 0


def test_an_agent_that_follows_a_goal_that_moves_is_in_none() -> None:
    assert deadlocks(lambda _time: 1.0, 60.0, lambda time: 5.0 + 0.1 * time) == 0


def test_a_way_round_counts_by_what_is_left_of_it() -> None:
    ahead: list[Any] = [[0.0, 3.0, 0.0], [5.0, 0.0, 0.0]]
    round_ = Paths(np.array([0, 0]), np.array(ahead))
    assert deadlocks(lambda time: 4.8 - 0.05 * time, 20.0) == 1  # it flies away from its goal
    assert deadlocks(lambda time: 4.8 - 0.05 * time, 20.0, paths=round_) == 0  # on a way round it


def test_an_agent_that_stands_behind_one_that_gets_on_waits() -> None:
    counter = flown([stands(0.0, 5.0), crawls(0.5, 5.0)], 20.0)
    assert (counter.waits, counter.count) == (1, 0)


def test_agents_queued_behind_a_moving_agent_wait() -> None:
    counter = flown([stands(-0.8, 5.0), stands(0.0, 5.0), crawls(0.5, 5.0)], 20.0)
    assert (counter.waits, counter.count) == (2, 0)


def test_face_to_face_agents_and_their_queue_are_deadlocked() -> None:
    counter = flown([stands(-0.5, 5.0), stands(0.0, 5.0), stands(0.5, -5.0)], 20.0)
    assert (counter.waits, counter.count) == (3, 3)


def test_that_one_behind_or_far_ahead_gets_on_helps_no_agent() -> None:
    assert flown([stands(0.0, 5.0), crawls(-0.9, 0.0)], 20.0).count == 1
    assert flown([stands(0.0, 5.0), crawls(1.6, 5.0)], 20.0).count == 1


def test_agents_behind_an_arrived_agent_are_deadlocked() -> None:
    counter = flown([stands(0.0, 5.0), stands(0.5, 0.5)], 20.0)
    assert (counter.waits, counter.count) == (1, 1)


def test_waits_become_deadlocks_when_the_last_mover_stops() -> None:
    stops: tuple[Track, Track] = (lambda time: 0.5 + 0.02 * min(time, 10.0), lambda _time: 5.0)
    before, after = (flown([stands(0.0, 5.0), stops], seconds) for seconds in (12.0, 20.0))
    assert (before.waits, before.count) == (1, 0)
    assert (after.waits, after.count) == (2, 2)


@given(st.integers(0, 2**32 - 1))
def test_more_moving_agents_never_reduce_the_waiting_agents(seed: int) -> None:
    random = np.random.default_rng(seed)
    position, goal = random.uniform(-1, 1, (2, 12, 3))
    few = random.random(12) < 0.2
    more = few | (random.random(12) < 0.2)
    near = Pairs.of(position, WAITING_DISTANCE)
    some, others = (waiting(near, position, goal, rows) for rows in (few, more))
    assert some[few].all()
    assert others[some].all()
    assert not waiting(near, position, goal, np.zeros(12, np.bool_)).any()
