"""Where agents may be that are no longer heard, and how others keep clear of them."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from star_core import (
    AgentPhase,
    Array,
    Estimate,
    Health,
    Limits,
    Mask,
    Registry,
    Setpoint,
    Telemetry,
)
from star_core.geometry.neighbours import Pairs
from star_core.messages.state import with_possible_positions
from star_core.safety.agents_in_the_way import (
    BRAKING_TIME,
    FALL_TIME,
    WATCHDOG_TIME,
    GroundedAgents,
    UnheardAgents,
)
from star_core.safety.filter import SafetyFilter
from star_core.testing import estimate, scene
from star_core.toolkit import TickState, fill_defaults

LIMITS = Limits(separation=0.2, vertical_separation=0.6)
DOWN = LIMITS.separation - LIMITS.vertical_separation  # m, as others keep only `separation` above
HEARD, UNHEARD = 0.0, 0.6  # s, ages of reports
ONE, BOTH = np.ones(1, np.bool_), np.ones(2, np.bool_)  # in the air


def reports(now: Estimate, age: Array, lands_by: Array | None = None) -> Telemetry:
    """The telemetry of agents whose last reports are so old, s."""
    attitude, state = np.zeros((len(age), 4)), np.zeros(len(age), np.int64)
    return Telemetry(
        now.time, now.position, now.velocity, attitude, age, state, age, lands_by=lands_by
    )


def mark(
    tracker: UnheardAgents,
    now: Estimate,
    age: Array,
    airborne: Mask,
    taken_over: Mask | None = None,
    lands_by: Array | None = None,
) -> Estimate:
    """The estimate as the tracker marks it, of agents (N,) that setpoints took over, or none."""
    phase = np.where(airborne, AgentPhase.FLYING, AgentPhase.GROUNDED)
    over = np.zeros(len(age), np.bool_) if taken_over is None else taken_over
    state = TickState(reports(now, age, lands_by), phase, over)
    state.estimate = now
    for use in tracker.check(state):
        now = cast("Estimate", use.value)
    return now


def marked(velocity: Array, *ages: float) -> Estimate:
    """The estimate of two agents at some (N, 3) velocity, m/s, after reports of these ages, s."""
    tracker = UnheardAgents(len(velocity), LIMITS)
    now = estimate(np.zeros_like(velocity), velocity=velocity)
    for age in ages:
        answer = mark(tracker, now, np.array([0.0, age]), BOTH)
    return answer


VELOCITY = np.array([[0.1, 0.0, 0.0], [0.4, -0.2, 0.0]])


def test_agents_that_are_heard_are_where_they_are() -> None:
    answer = marked(VELOCITY, HEARD)
    assert not answer.possible_travel.any()
    assert answer.velocity.tolist() == VELOCITY.tolist()


def test_an_agent_that_is_not_heard_stands_still_or_flies_on() -> None:
    answer = marked(VELOCITY, HEARD, UNHEARD)
    assert answer.velocity.tolist() == [VELOCITY[0].tolist(), [0, 0, 0]]
    assert answer.possible_travel[0].tolist() == [0, 0, 0]
    assert answer.possible_travel[1] == pytest.approx(WATCHDOG_TIME * VELOCITY[1])


def test_an_agent_that_is_heard_again_is_where_it_is() -> None:
    answer = marked(VELOCITY, HEARD, UNHEARD, HEARD)
    assert not answer.possible_travel.any()


def test_the_velocity_is_the_last_one_that_was_reported() -> None:
    tracker = UnheardAgents(1, LIMITS)
    flying = estimate(np.zeros((1, 3)), velocity=np.array([[0.5, 0.0, 0.0]]))
    unknown = replace(flying, velocity=np.full((1, 3), np.nan))
    mark(tracker, flying, np.array([HEARD]), ONE)
    answer = mark(tracker, unknown, np.array([UNHEARD]), ONE)
    assert answer.possible_travel[0] == pytest.approx([WATCHDOG_TIME * 0.5, 0, 0])


def test_possible_positions_cover_the_stretch_and_are_inactive() -> None:
    now = marked(VELOCITY, HEARD, UNHEARD)
    every = np.ones(2, np.bool_)
    planned = Setpoint(VELOCITY, np.zeros(2), every)
    estimates, extended = with_possible_positions(now, planned, spacing=0.2)
    added = estimates.position[2:]
    assert added[-1] == pytest.approx(WATCHDOG_TIME * VELOCITY[1])
    steps = np.diff(np.vstack([now.position[1], added]), axis=0)
    assert np.linalg.norm(steps, axis=1).max() <= 0.2
    assert extended.active.tolist() == [True, True] + [False] * len(added)
    assert not estimates.velocity[2:].any()


def test_unheard_agents_count_as_down_after_landing_or_falling() -> None:
    heard, every = np.array([True, False, False, True]), np.arange(4)
    tracker = UnheardAgents(4, LIMITS)
    tracker.flies_on_board(every, np.tile([np.nan, np.nan, 0.7], (4, 1)), np.full(4, 1.0))
    tracker.steered(1.0, np.array([False, True, False, False]))
    tracker.lands(np.array([1, 2, 3]), np.array([6.0, 6.0, 3.0]), heard[1:])
    ages = np.array([9.0, 9.0, 9.0, 9.0])

    def heights(time: float) -> list[float]:
        now = estimate(np.tile([0.0, 0.0, 0.7], (4, 1)), time=time)
        taken_over = every == 1
        fresh = mark(tracker, now, 0 * ages, every >= 0, taken_over)
        assert fresh.position[:, 2].tolist() == [0.7] * 4
        return [float(z) for z in mark(tracker, now, ages, every >= 0).position[:, 2]]

    assert heights(2.9) == [0.7, 0.7, 0.7, 0.7]
    assert heights(3.0) == [0.7, 0.7, 0.7, DOWN]  # received the command to land
    assert heights(6.0) == [0.7, DOWN, 0.7, DOWN]  # landed, or fell for want of setpoints
    assert heights(99.0) == [0.7, DOWN, 0.7, DOWN]  # the others may hover


def test_setpoints_keep_an_agent_in_the_air() -> None:
    tracker = UnheardAgents(1, LIMITS)
    fallen = WATCHDOG_TIME + FALL_TIME
    for time in (1.0, 2.0):
        tracker.steered(time, np.array([True]))
    now = [estimate(np.ones((1, 3)), time=time + fallen) for time in (1.0, 2.0)]
    assert [mark(tracker, moment, np.array([UNHEARD]), ONE).position[0, 2] for moment in now] == [
        1.0,
        DOWN,
    ]


def test_unlocated_agents_travel_by_their_braking_distance() -> None:
    tracker = UnheardAgents(2, LIMITS)
    flying = estimate(np.zeros((2, 3)), velocity=VELOCITY)
    lost = replace(flying, velocity=np.zeros((2, 3)), valid=np.array([True, False]))
    ages, grounded = np.zeros(2), ~BOTH
    assert not mark(tracker, lost, ages, grounded).possible_travel.any()  # before the takeoff
    mark(tracker, flying, ages, BOTH)
    for airborne in (BOTH, grounded):
        answer = mark(tracker, lost, ages, airborne)
        assert answer.possible_travel[1] == pytest.approx(BRAKING_TIME * VELOCITY[1])
        assert not answer.possible_travel[0].any()
    assert not mark(tracker, flying, ages, grounded).possible_travel.any()
    assert not mark(tracker, lost, ages, grounded).possible_travel.any()


# Agents that fly a command on board: a climb to 0.8 m, last heard at 0.3 m.

TOP, LAST = 0.8, 0.3  # m
CLIMBED_AT, LANDS_BY = 2.0, 9.0  # s


def climbing() -> UnheardAgents:
    """A tracker of an agent that takes off at 0 s."""
    tracker = UnheardAgents(1, LIMITS)
    tracker.flies_on_board(np.array([0]), np.array([[np.nan, np.nan, TOP]]), np.array([CLIMBED_AT]))
    return tracker


def column(
    tracker: UnheardAgents, time: float, lands_by: float | None, *, taken_over: bool = False
) -> tuple[float, float]:
    """Highest and lowest z at which the agent may be, m, if it is not heard."""
    now = estimate(np.array([[1.0, 2.0, LAST]]), velocity=np.array([[0.0, 0.0, 0.5]]), time=time)
    announced = None if lands_by is None else np.array([lands_by])
    mark(tracker, now, np.array([HEARD]), ONE)
    stale = mark(tracker, now, np.array([UNHEARD]), ONE, np.array([taken_over]), announced)
    assert stale.position[0, :2].tolist() == [1.0, 2.0]
    ends = [float(stale.position[0, 2]), float((stale.position + stale.possible_travel)[0, 2])]
    return max(ends), min(ends)


@pytest.mark.parametrize("time", [0.5, CLIMBED_AT, LANDS_BY - 0.1])
def test_an_unheard_climb_that_comes_down_takes_the_whole_column(time: float) -> None:
    assert column(climbing(), time, LANDS_BY) == pytest.approx((TOP, 0.0))


def test_an_unheard_climb_that_has_come_down_is_on_the_ground() -> None:
    assert column(climbing(), LANDS_BY, LANDS_BY) == pytest.approx((DOWN, DOWN))


@pytest.mark.parametrize("lands_by", [None, np.inf, CLIMBED_AT - 0.1])
def test_unheard_climbs_hover_unless_a_descent_is_announced(lands_by: float | None) -> None:
    """An end before that of the climb was announced for an earlier flight."""
    assert column(climbing(), 99.0, lands_by) == pytest.approx((TOP, LAST))


def test_a_landing_that_may_not_be_heard_does_not_end_a_column() -> None:
    tracker = climbing()
    tracker.lands(np.array([0]), np.array([4.0]), ~ONE)
    assert column(tracker, LANDS_BY - 0.1, LANDS_BY) == pytest.approx((TOP, 0.0))
    tracker.lands(np.array([0]), np.array([LANDS_BY + 3.0]), ~ONE)  # the next one may be
    assert column(tracker, LANDS_BY + 2.9, LANDS_BY) == pytest.approx((TOP, 0.0))
    assert column(tracker, LANDS_BY + 3.0, LANDS_BY) == pytest.approx((DOWN, DOWN))


def test_setpoints_that_may_not_be_heard_do_not_end_a_column() -> None:
    tracker = climbing()
    tracker.steered(CLIMBED_AT, ONE)
    assert column(tracker, LANDS_BY - 0.1, LANDS_BY) == pytest.approx((TOP, 0.0))
    fallen = CLIMBED_AT + WATCHDOG_TIME + FALL_TIME
    assert column(tracker, fallen, LANDS_BY, taken_over=True) == pytest.approx((DOWN, DOWN))


@pytest.mark.parametrize(("lands_by", "lowest"), [(None, TOP), (LANDS_BY, 0.0)])
def test_an_unheard_flight_on_board_is_at_its_end_later(
    lands_by: float | None, lowest: float
) -> None:
    tracker, end = UnheardAgents(1, LIMITS), np.array([[1.0, 2.0, TOP]])
    tracker.flies_on_board(np.array([0]), end, np.array([CLIMBED_AT]))
    announced = None if lands_by is None else np.array([lands_by])
    last = estimate(np.array([[0.5, 2.0, TOP]]), velocity=np.array([[0.2, 0.0, 0.0]]))
    mark(tracker, last, np.array([HEARD]), ONE)
    ages, away = np.array([UNHEARD]), np.array([0.5, 2.0, TOP])
    before = mark(tracker, replace(last, time=1.0), ages, ONE, None, announced)
    assert before.position[0] == pytest.approx(away)
    assert before.possible_travel[0] == pytest.approx([WATCHDOG_TIME * 0.2, 0.0, 0.0])
    later = mark(tracker, replace(last, time=3.0), ages, ONE, None, announced)
    assert later.position[0] == pytest.approx(end[0])
    assert later.possible_travel[0] == pytest.approx([0.0, 0.0, lowest - TOP])


def test_an_unlocated_agent_that_lands_passes_all_heights_below() -> None:
    tracker, high = UnheardAgents(1, LIMITS), estimate(np.array([[0.0, 0.0, 1.3]]))
    lost = replace(high, valid=~ONE)
    mark(tracker, high, np.zeros(1), ONE)
    assert not mark(tracker, lost, np.zeros(1), ONE).possible_travel.any()
    tracker.lands(np.array([0]), np.array([5.0]), ONE)
    assert mark(tracker, lost, np.zeros(1), ONE).possible_travel.tolist() == [[0.0, 0.0, -1.3]]
    assert not mark(tracker, lost, np.zeros(1), ~ONE).possible_travel.any()  # it is down


# Agents that stay on the ground.

GROUNDED, LANDED, FALLEN = AgentPhase.GROUNDED, AgentPhase.LANDED, AgentPhase.EMERGENCY


def test_only_agents_staying_grounded_free_the_air_above_them() -> None:
    tracker = GroundedAgents(4, LIMITS)
    phase, gone = np.array([GROUNDED, LANDED, LANDED, FALLEN]), np.array([True, True, False, False])

    def heights(time: float) -> list[float]:
        now = estimate(np.zeros((4, 3)), time=time)
        state = TickState(reports(now, np.zeros(4)), phase, gone)
        state.estimate, state.gone, state.health = now, gone, Health(phase, 0 * phase, 0 * phase)
        return [
            float(z)
            for use in tracker.check(state)
            for z in cast("Estimate", use.value).position[:, 2]
        ]

    assert heights(0.0) == [0, DOWN, 0, 0]  # the last one may still fall
    assert heights(FALL_TIME) == [0, DOWN, 0, DOWN]


# Flights: the second agent is last heard at the origin, flying along +x, and is in fact there or
# flies on for two seconds; the first crosses its way.

PERIOD, RADIUS = 0.05, 0.3  # s, m
FIRST = np.array([True, False])


def crossed(avoider: str, start: Array, goal: Array, *, stopped: bool) -> float:
    """How near the first agent comes to the one that is not heard, m, on its way to a goal."""
    room = scene(2)
    spec = Registry().find("avoider", avoider).offer
    options = {} if avoider == "none" else {"radius": RADIUS}
    made = spec.make(room, **fill_defaults(options, spec.options))
    tracker, guard = UnheardAgents(2, LIMITS), SafetyFilter(room)
    speed, position = 0.5, np.array([start, np.zeros(3)])
    last = np.array([[0.0, 0.0, 0.0], [speed, 0.0, 0.0]])
    mark(tracker, estimate(position, velocity=last), np.zeros(2), BOTH)
    other, velocity, nearest = np.zeros(3), np.zeros(3), np.inf
    for k in range(round(12 / PERIOD)):
        time = k * PERIOD
        if not stopped and time < WATCHDOG_TIME:
            other = other + PERIOD * last[1]
        nearest = min(nearest, float(np.linalg.norm(position[0] - other)))
        now = estimate(
            np.array([position[0], np.zeros(3)]), velocity=np.array([velocity, last[1]]), time=time
        )
        now = replace(mark(tracker, now, np.array([0.0, 0.6 + time]), BOTH), valid=FIRST)
        way = goal - position[0]
        wish = way * speed / max(np.linalg.norm(way), speed)
        planned = Setpoint(np.array([wish, np.zeros(3)]), np.zeros(2), FIRST)
        sent, _ = guard.filter(
            now, made.avoid(now, planned), planned, Pairs.of(now.position, guard.reach)
        )
        velocity = velocity + PERIOD / 0.3 * (sent.velocity[0] - velocity)  # lag of first order
        position[0] = position[0] + PERIOD * velocity
    return nearest


@pytest.mark.parametrize("avoider", ["orca", "voronoi"])
@pytest.mark.parametrize("stopped", [True, False])
@pytest.mark.parametrize(
    ("start", "goal"),
    [((0.5, -1.5), (0.5, 1.5)), ((-1.5, 0.1), (2.5, 0.1)), ((2.5, -0.1), (-1.5, -0.1))],
)
def test_avoiders_keep_clear_of_possible_unheard_positions(
    avoider: str,
    stopped: bool,  # noqa: FBT001 -- the case
    start: tuple[float, float],
    goal: tuple[float, float],
) -> None:
    nearest = crossed(avoider, np.array([*start, 0.0]), np.array([*goal, 0.0]), stopped=stopped)
    assert nearest >= 0.93 * 2 * RADIUS


def moved_aside(avoider: str, height: float) -> float:
    """How far an agent is from a column after some seconds, m, if it hovers in it at a height."""
    room = scene(2)
    spec = Registry().find("avoider", avoider).offer
    options = {} if avoider == "none" else {"radius": RADIUS}
    made = spec.make(room, **fill_defaults(options, spec.options))
    guard, tracker = SafetyFilter(room), UnheardAgents(2, LIMITS)
    tracker.flies_on_board(np.array([1]), np.array([[np.nan, np.nan, TOP]]), np.array([0.1]))
    velocity, position = np.zeros(3), np.array([0.1, 0.0, height])
    rest = Setpoint(np.zeros((2, 3)), np.zeros(2), FIRST)
    for k in range(round(5 / PERIOD)):
        now = estimate(
            np.array([position, [0.0, 0.0, LAST]]),
            velocity=np.array([velocity, np.zeros(3)]),
            time=k * PERIOD,
        )
        now = mark(tracker, now, np.array([HEARD, UNHEARD]), BOTH, ~BOTH, np.full(2, 99.0))
        now = replace(now, valid=FIRST)
        near = Pairs.of(now.position, guard.reach)
        sent, _ = guard.filter(now, made.avoid(now, rest), rest, near)
        velocity = velocity + PERIOD / 0.3 * (sent.velocity[0] - velocity)
        position = position + PERIOD * velocity
    return float(np.hypot(*position[:2]))


@pytest.mark.parametrize("height", [0.1, 0.5, TOP])
@pytest.mark.parametrize("avoider", ["orca", "voronoi", "potential"])
def test_an_agent_in_the_way_of_a_descent_moves_aside(avoider: str, height: float) -> None:
    assert moved_aside(avoider, height) >= 0.93 * 2 * RADIUS


@pytest.mark.parametrize("height", [0.1, 0.5, TOP])
def test_the_safety_filter_moves_agents_out_of_a_descent(height: float) -> None:
    assert moved_aside("none", height) >= 0.95 * scene(1).limits.separation


def test_safety_filter_keeps_clear_of_possible_positions() -> None:
    nearest = crossed("none", np.array([1.0, -1.5, 0.0]), np.array([1.0, 1.5, 0.0]), stopped=False)
    assert nearest >= 0.95 * scene(1).limits.separation
