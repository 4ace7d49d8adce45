"""Agents pressed against the fence are drawn in; stuck planners and avoiders are found."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from star_core import Array, Estimate, Goals, Scene, Setpoint
from star_core.testing import estimate, scene
from star_core.testing.inputs import flight_telemetry
from star_core.toolkit import Strike, TickState, Use
from star_monitors.setpoint_monitor import (
    ARRIVAL,
    MAX_DRAW_IN,
    MIN_CHANGE,
    OUTWARD_TIME,
    REPEATED_TIME,
    SIGMAS,
    SetpointMonitor,
)

SPEED, TICK, HIGH = 0.5, 0.05, float(scene(1).world.fence.high[0])  # m/s, s, m
Way = Callable[[int], tuple[float, ...]]
"""Numbers along x of two agents, by tick."""


def along(values: tuple[float, ...]) -> Array:
    return np.array([(x, 0.3, 1.0) for x in values])


def setpoint(values: tuple[float, ...]) -> Setpoint:
    n = len(values)
    return Setpoint(np.array([(x, 0.0, 0.0) for x in values]), np.zeros(n), np.ones(n, np.bool_))


def goals_at(position: Array, speed: float = 0.0) -> Goals:
    n = len(position)
    return Goals(position, np.full((n, 3), speed), np.zeros(n), np.ones(n), np.ones(n, np.bool_))


class Watched:
    """A monitor of a scene, a tick after the other.

    Attributes:
        strikes: Of the last tick: reasons by kind.
    """

    def __init__(self, room: Scene) -> None:
        self._room, self._none = room, np.zeros(len(room.agents), np.bool_)
        self._monitor = SetpointMonitor(room)
        self.strikes: dict[str, str] = {}

    def sent(self, now: Estimate, goals: Goals, avoided: Setpoint, planned: Setpoint) -> Setpoint:
        """Return the avoider's setpoint as the monitor changes it."""
        telemetry = flight_telemetry(self._room, 0.0, self._none, self._none)
        state = TickState(telemetry, np.zeros(len(self._none), np.int64), self._none)
        state.estimate, state.goals, state.redirected = now, goals, self._none
        state.setpoint, state.planned = avoided, planned
        self.strikes = {}
        for finding in self._monitor.check(state):
            match finding:
                case Use("setpoint", Setpoint() as drawn_in):
                    avoided = drawn_in
                case Strike(kind, reason):
                    self.strikes[kind] = reason
        return avoided


def flown(
    avoider: Way,
    planner: Way,
    position: Way = lambda k: (0.01 * k, 0.01 * k),
    goal: Way = lambda _: (99.0, 99.0),
    goal_velocity: float = 0.0,
) -> dict[str, tuple[float, str]]:
    """Return when avoider or planner is found within 5 s, and why, by its kind."""
    strikes: dict[str, tuple[float, str]] = {}
    watched = Watched(scene(2))
    for k in range(100):
        goals = goals_at(along(goal(k)), goal_velocity)
        setpoints = setpoint(avoider(k)), setpoint(planner(k))
        watched.sent(estimate(along(position(k))), goals, *setpoints)
        for kind, reason in watched.strikes.items():
            strikes.setdefault(kind, (k * TICK, reason))
    return strikes


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
    strikes = flown(noisy(0.5), lambda k: (0.5, 0.5 + 1e-15 * k), passing, same(1.0))
    [(kind, (time, reason))] = strikes.items()
    assert (kind, reason) == ("planner", "repeats a setpoint that leads cf1 past the goal")
    assert time == pytest.approx((1.0 + ARRIVAL) / 0.5 + REPEATED_TIME, abs=2 * TICK)


@pytest.mark.parametrize(
    ("aside", "goal", "is_reported"),
    [(0.9, (1.0, 0.3), True), (0.9, (9.0, 0.3), False), (0.9 * ARRIVAL, (1.0, 0.1), False)],
)
def test_a_planner_that_passes_beside_the_goal_is_found(
    aside: float, goal: tuple[float, float], *, is_reported: bool
) -> None:
    watched, strikes = Watched(scene(2)), []
    goals = goals_at(np.array([(99.0, 0.3, 1.0), (*goal, 1.0)]))
    for k in range(100):
        position = along(passing(k))
        position[1, 1] += min(0.01 * k, aside)  # others push cf2 aside
        watched.sent(estimate(position), goals, setpoint(noisy(0.4)(k)), setpoint((0.5, 0.5)))
        strikes += [(k * TICK, strike) for strike in watched.strikes.items()]
    assert bool(strikes) == is_reported
    if is_reported:
        time, strike = strikes[0]
        assert strike == ("planner", "repeats a setpoint that leads cf2 past the goal")
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

    def leaving(k: int) -> tuple[float, ...]:
        return HIGH + 1e-3 * k, 1e-3 * k

    time, reason = flown(avoider, planner, leaving)[kind]
    assert reason == "repeats a setpoint that leads cf1 out of the fence"
    assert time == pytest.approx(OUTWARD_TIME, abs=2 * TICK)
    assert not flown(avoider, planner, lambda _: (HIGH, 0.0))  # it stands still
    assert not flown(noisy(0.5), noisy(0.5), leaving)


def believed(x: float, velocity: float, std: float) -> Estimate:
    """An agent at a position, m, with this standard deviation along every axis, m."""
    now = estimate(along((x,)), velocity=np.array([(velocity, 0.0, 0.0)]))
    return replace(now, covariance=std**2 * np.eye(3)[None])


def pressed(std: float, *, avoider: float = SPEED) -> tuple[Watched, float]:
    """Press an agent against the fence, which stops it there; return its position, m.

    The avoider may command less than the planner, which commands `SPEED`. Nothing is reported.
    """
    watched, x, velocity = Watched(scene(1)), HIGH - 1, 0.0
    for k in range(400):
        room = max(0.0, 2.5 * (HIGH - x - 0.4 * velocity))  # by the safety filter
        setpoints = setpoint((min(avoider, room),)), setpoint((SPEED - 1e-15 * k,))
        sent = watched.sent(believed(x, velocity, std), Goals.none(1), *setpoints)
        limited = min(float(sent.velocity[0, 0]), room)
        velocity += (1 - math.exp(-TICK / 0.35)) * (limited - velocity)
        x += TICK * velocity
    return watched, x


@pytest.mark.parametrize("avoider", [SPEED, 0.1])
def test_pressing_against_the_fence_draws_in_by_uncertainty(avoider: float) -> None:
    assert pressed(0.1, avoider=avoider)[1] == pytest.approx(HIGH - SIGMAS * 0.1, abs=0.01)
    assert pressed(0.0)[1] == pytest.approx(HIGH, abs=0.01)
    assert pressed(99.0)[1] >= HIGH - MAX_DRAW_IN - 0.01


def test_drawn_in_agents_still_reach_goals_near_the_fence() -> None:
    watched, x = pressed(0.1)

    def sent(speed: float) -> float:
        setpoints = setpoint((speed,)), setpoint((speed,))
        drawn_in = watched.sent(believed(x, 0.0, 0.1), Goals.none(1), *setpoints)
        return float(drawn_in.velocity[0, 0])

    assert sent(0.3) < 0.05
    assert sent(-0.3) == -0.3
    for _ in range(40):
        assert sent(0.3) == 0.3


def test_unbraked_planners_at_the_fence_are_not_detected() -> None:
    """The safety filter slows its agent down, so that it takes long to arrive."""
    watched, goals = Watched(scene(1)), goals_at(along((HIGH,)))
    x, velocity, ticks, planned = HIGH - 2.0, 0.0, 0, setpoint((0.5,))
    while x < HIGH - 0.1:
        now = believed(x, velocity, 0.01)
        answer = float(watched.sent(now, goals, planned, planned).velocity[0, 0])
        assert not watched.strikes
        if answer < 0.0:
            break
        room = max(0.0, 2.5 * (HIGH - x - 0.4 * velocity))  # by the safety filter
        velocity += (1 - math.exp(-TICK / 0.35)) * (min(answer, room) - velocity)
        x, ticks = x + TICK * velocity, ticks + 1
    assert ticks > 40
