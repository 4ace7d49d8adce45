"""Planners and avoiders that are stuck are found, and no others."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from star_core import Array, Goals, Setpoint
from star_core.testing import estimate, scene
from star_core.testing.inputs import flight_telemetry
from star_core.toolkit import Strike, TickState
from star_monitors.setpoint_monitor import (
    ARRIVAL,
    MIN_CHANGE,
    OUTWARD_TIME,
    REPEATED_TIME,
    FencePress,
    RepeatedSetpoints,
    SetpointMonitor,
)

TICK = 0.05  # s
Way = Callable[[int], tuple[float, ...]]
"""Numbers along x of two agents, by tick."""


def along(values: tuple[float, ...]) -> Array:
    return np.array([(x, 0.3, 1.0) for x in values])


def setpoint(values: tuple[float, ...]) -> Setpoint:
    n = len(values)
    return Setpoint(np.array([(x, 0.0, 0.0) for x in values]), np.zeros(n), np.ones(n, np.bool_))


def flown(
    avoider: Way,
    planner: Way,
    position: Way = lambda k: (0.1 * k, 0.1 * k),
    goal: Way = lambda _: (99.0, 99.0),
    goal_velocity: float = 0.0,
    *,
    outward: tuple[bool, bool] = (False, False),
) -> dict[str, tuple[float, str]]:
    """Return when avoider or planner is found within 5 s, and why, by its kind."""
    found: dict[str, tuple[float, str]] = {}
    repeated = RepeatedSetpoints(scene(2))
    for k in range(100):
        goals = Goals(
            along(goal(k)),
            np.full((2, 3), goal_velocity),
            np.zeros(2),
            np.ones(2),
            np.ones(2, np.bool_),
        )
        leads_out = np.array([outward, (False, False)]).T
        wanted = setpoint(planner(k))
        avoided = setpoint(avoider(k))
        reasons = repeated.find(estimate(along(position(k))), goals, avoided, wanted, leads_out)
        for kind, reason in reasons.items():
            found.setdefault(kind, (k * TICK, reason))
    return found


def noisy(speed: float) -> Way:
    return lambda k: (speed + 1e-15 * k, speed - 1e-15 * k)


def same(speed: float) -> Way:
    return lambda _: (speed, speed)


def braking(k: int) -> tuple[float, ...]:
    return max(0.0, 0.5 - 0.02 * k), 0.5


def test_an_avoider_that_does_not_follow_the_planner_is_found() -> None:
    [(kind, (time, reason))] = flown(same(0.5), braking).items()
    assert (kind, reason) == ("avoider", "repeats its setpoints, whatever the planner's are")
    assert time == pytest.approx(MIN_CHANGE / 0.4 + REPEATED_TIME, abs=2 * TICK)


@pytest.mark.parametrize(
    ("avoider", "planner"),
    [
        (noisy(0.5), braking),
        (same(0.0), braking),  # it holds the agents where they are
        (same(0.5), lambda k: (0.5 - 0.001 * k, 0.5)),
        (lambda k: (0.5, 0.5 - 1e-15 * k), braking),  # of one agent only
        (lambda k: (braking(k // 8 * 8)[0], 0.5), braking),  # computed every 0.4 s
    ],
    ids=["changes", "zero", "small", "one", "slow"],
)
def test_an_avoider_that_has_reasons_is_not_found(avoider: Way, planner: Way) -> None:
    assert not flown(avoider, planner)


def passing(k: int) -> tuple[float, ...]:
    return 0.5 * k * TICK, 0.5 * k * TICK


def test_a_planner_that_flies_past_the_goal_is_found() -> None:
    found = flown(noisy(0.5), lambda k: (0.5, 0.5 + 1e-15 * k), passing, same(1.0))
    [(kind, (time, reason))] = found.items()
    assert (kind, reason) == ("planner", "repeats a setpoint that leads cf1 past the goal")
    assert time == pytest.approx((1.0 + ARRIVAL) / 0.5 + REPEATED_TIME, abs=2 * TICK)


@pytest.mark.parametrize(
    ("aside", "goal", "found"),
    [(0.9, (1.0, 0.3), True), (0.9, (9.0, 0.3), False), (0.9 * ARRIVAL, (1.0, 0.1), False)],
)
def test_a_planner_that_passes_beside_the_goal_is_found(
    aside: float, goal: tuple[float, float], *, found: bool
) -> None:
    monitor = SetpointMonitor(scene(2))
    none, steered = np.zeros(2, np.bool_), np.ones(2, np.bool_)
    state = TickState(flight_telemetry(scene(2), 0.0, none, none), np.zeros(2, np.int64), none)
    there = np.array([(99.0, 0.3, 1.0), (*goal, 1.0)])
    goals = Goals(there, np.zeros((2, 3)), np.zeros(2), np.ones(2), steered)
    state.redirected, state.goals, strikes = none, goals, []
    for k in range(100):
        position = along(passing(k))
        position[1, 1] += min(0.01 * k, aside)  # others push cf2 aside
        state.estimate = estimate(position)
        state.planned, state.setpoint = setpoint((0.5, 0.5)), setpoint(noisy(0.4)(k))
        strikes += [(k * TICK, finding) for finding in monitor.check(state)]
    assert bool(strikes) == found
    if found:
        time, strike = strikes[0]
        assert strike == Strike("planner", "repeats a setpoint that leads cf2 past the goal")
        assert time == pytest.approx(1.0 / 0.5 + REPEATED_TIME, abs=2 * TICK)


def oscillating(k: int) -> tuple[float, ...]:
    return 0.9 * ARRIVAL * (-1) ** k, 0.9 * ARRIVAL * (-1) ** k


@pytest.mark.parametrize(
    ("position", "goal", "goal_velocity"),
    [
        (oscillating, same(0.0), 0.0),
        (passing, lambda k: (passing(k)[0] - 0.01, 9.0), 0.0),
        (passing, same(1.0), 0.5),
        (passing, same(-9.0), 0.0),
    ],
    ids=["at the goal", "the goal moves", "the goal has a velocity", "never near"],
)
def test_a_planner_that_has_reasons_is_not_found(
    position: Way, goal: Way, goal_velocity: float
) -> None:
    assert not flown(noisy(0.5), same(0.5), position, goal, goal_velocity)


@pytest.mark.parametrize("kind", ["avoider", "planner"])
def test_repeated_setpoints_out_of_the_fence_are_detected(kind: str) -> None:
    avoider = same(0.5) if kind == "avoider" else noisy(0.5)
    planner = same(0.5) if kind == "planner" else noisy(0.5)
    outward = kind == "avoider", kind == "planner"
    time, reason = flown(avoider, planner, outward=outward)[kind]
    assert reason == "repeats a setpoint that leads cf1 out of the fence"
    assert time == pytest.approx(OUTWARD_TIME, abs=2 * TICK)
    assert not flown(avoider, planner, same(0.0), outward=outward)  # it stands still
    assert not flown(noisy(0.5), noisy(0.5), outward=outward)


def test_unbraked_planners_at_the_fence_are_not_detected() -> None:
    """The safety filter slows its agent down, so that it takes long to arrive."""
    one = scene(1)
    press, repeated = FencePress(one), RepeatedSetpoints(one)
    high, goal = float(one.world.fence.high[0]), along((float(one.world.fence.high[0]),))
    goals = Goals(goal, np.zeros((1, 3)), np.zeros(1), np.ones(1), np.ones(1, np.bool_))
    here, velocity, ticks = high - 2.0, 0.0, 0
    while here < high - 0.1:
        now = estimate(along((here,)), velocity=np.array([(velocity, 0.0, 0.0)]))
        drawn_in, outward = press.draw_in(now, setpoint((0.5,)), setpoint((0.5,)))
        assert not repeated.find(now, goals, setpoint((0.5,)), setpoint((0.5,)), outward)
        answer = float(drawn_in.velocity[0, 0])
        if answer < 0.0:
            break
        room = max(0.0, 2.5 * (high - here - 0.4 * velocity))  # by the safety filter
        velocity += (1 - math.exp(-TICK / 0.35)) * (min(answer, room) - velocity)
        here, ticks = here + TICK * velocity, ticks + 1
    assert ticks > 40
