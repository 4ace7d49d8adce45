"""Motion of one agent by its odometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from star_apriltag.dead_reckoning import ARM_X, predict, start
from star_apriltag.odometry_track import (
    CAPACITY,
    TILT_CORRECTION,
    VELOCITY_CORRECTION,
    Motion,
    OdometryTrack,
)
from star_core import Agent, Array, Odometry

number = st.floats(-1.0, 1.0)
samples = st.lists(
    st.tuples(st.floats(0.005, 0.3), number, number, number), min_size=1, max_size=20
)


def stream(time: Any, velocity: Array, yaw_rate: Any, agent: int = 0) -> Odometry:
    """Samples of one agent at rest in height."""
    n = len(time)
    zero = np.zeros(n)
    return Odometry(np.full(n, agent), np.asarray(time), velocity, yaw_rate, zero, zero, zero)


def track(rows: Sequence[tuple[float, float, float, float]]) -> OdometryTrack:
    """A track of (time since the last one, forward, left, yaw rate)."""
    table = np.array(rows)
    velocity = np.column_stack([table[:, 1:3], np.zeros(len(table))])
    made = OdometryTrack()
    made.add(stream(np.cumsum(table[:, 0]), velocity, table[:, 3]), np.arange(len(table)))
    return made


def even(
    seconds: float, velocity: tuple[float, float] = (1.0, 0.0), yaw_rate: float = 0.0
) -> OdometryTrack:
    """100 samples a second, all alike."""
    return track([(0.01, *velocity, yaw_rate)] * round(100 * seconds))


@given(samples, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_a_motion_is_what_an_integrator_finds(
    rows: list[tuple[float, float, float, float]], fraction: float, other: float
) -> None:
    times = np.cumsum([row[0] for row in rows])
    begin, end = sorted((fraction * times[-1], other * times[-1]))
    shift, turn = 0j, 0.0
    for k, (took, forward, left, rate) in enumerate(rows):
        first, last = np.clip([times[k] - took, times[k]], begin, end)

        def slope(_t: float, state: Array, *held: float) -> list[float]:
            go = complex(held[0], held[1]) * np.exp(1j * state[2])
            return [go.real, go.imag, held[2]]

        if last > first:
            held = (forward, left, rate)
            start = [shift.real, shift.imag, turn]
            solved = solve_ivp(slope, (0.0, last - first), start, args=held, rtol=1e-9, atol=1e-12)
            x, y, turn = solved.y[:, -1]
            shift = complex(x, y)
    motion = track(rows).between(begin, end)
    assert motion.turn == pytest.approx(turn, abs=1e-9)
    # A chord stands for the arc within a sample: 1 - sinc(0.3 / 2) of a metre a second at most.
    assert abs(motion.shift - shift) < 0.004 * motion.length + 1e-9


@given(samples, st.lists(st.floats(0.0, 1.2), min_size=3, max_size=3).map(sorted))
def test_a_motion_is_the_sum_of_its_two_parts(
    rows: list[tuple[float, float, float, float]], share: list[float]
) -> None:
    made = track(rows)
    begin, middle, end = (s * made.newest for s in share)
    whole, first, second = (
        made.between(*span) for span in ((begin, end), (begin, middle), (middle, end))
    )
    assert whole.turn == pytest.approx(first.turn + second.turn, abs=1e-9)
    assert whole.length == pytest.approx(first.length + second.length, abs=1e-9)
    assert whole.duration == pytest.approx(first.duration + second.duration, abs=1e-9)
    joined = first.shift + np.exp(1j * first.turn) * second.shift
    assert abs(whole.shift - joined) < 0.004 * whole.length + 1e-9  # one chord more


def test_beyond_the_newest_sample_the_motion_goes_on() -> None:
    assert even(1.0, (0.5, 0.0)).between(0.5, 3.0).shift == pytest.approx(1.25)
    assert even(1.0, yaw_rate=0.2).between(2.0, 3.0).turn == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("motors", "speed", "rate", "stands"),
    [
        (False, 0.0, 0.008, True),
        (False, 0.03, 0.0, True),
        (False, 0.1, 0.0, False),  # it is carried about
        (False, 0.0, -0.1, False),  # it is turned by hand
        (True, 0.0, 0.008, False),  # it hovers
    ],
)
def test_an_agent_that_stands_neither_moves_nor_turns(
    motors: bool,  # noqa: FBT001
    speed: float,
    rate: float,
    stands: bool,  # noqa: FBT001
) -> None:
    made, time = OdometryTrack(), np.arange(1, 101) / 100
    velocity = np.full((100, 3), [speed, 0.0, 0.0])
    made.add(stream(time, velocity, np.full(100, rate)), np.arange(100), motors=motors)
    motion = made.between(0.0, 1.0, yaw_bias=0.004)
    if stands:
        assert motion == Motion(0j, 0.0, 0.0, 0.0, 0.0, 0.0)
    else:
        assert motion.turn == pytest.approx(rate - 0.004)
        assert (motion.length, motion.duration) == pytest.approx((speed, 1.0))


def test_a_stand_between_two_ways_takes_no_time() -> None:
    made = even(1.0, (0.5, 0.0), 0.2)
    made.add(stream([61.0], np.zeros((1, 3)), np.zeros(1)), np.arange(1), motors=False)
    made.add(stream([62.0], np.array([[0.5, 0, 0]]), np.full(1, 0.2)), np.arange(1))
    motion = made.between(0.0, 62.0, yaw_bias=0.1)
    assert motion.turn == pytest.approx(0.2)
    assert (motion.length, motion.duration, motion.blind_duration) == pytest.approx((1.0, 2.0, 2.0))


def test_the_flow_sensors_scale_is_not_that_of_the_camera() -> None:
    made = even(12.0, (0.5, 0.0))
    made.correct(10.0, 11.0, 0.4 + 0j, yaw_bias=0.0)
    motion = made.between(10.0, 12.0, scale=1.1)
    assert motion.shift == pytest.approx(0.4 + 0.55)
    assert motion.blind_shift == pytest.approx(0.55)


def test_without_a_sample_or_time_nothing_moves() -> None:
    assert OdometryTrack().between(1.0, 3.0) == Motion(0j, 0.0, 0.0, 2.0, 0.0, 2.0)
    assert even(1.0).between(0.8, 0.3) == Motion(0j, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("times", [[0.2, 0.1, 0.3], [0.1, 0.1, 0.3], [0.1, math.nan, 0.3]])
def test_samples_that_go_backwards_or_have_no_time_are_ignored(times: list[float]) -> None:
    made = OdometryTrack()
    forward = np.array([[1.0, 0, 0], [100.0, 0, 0], [1.0, 0, 0]])
    made.add(stream(times, forward, np.zeros(3)), np.arange(3))
    assert made.newest == 0.3
    assert made.between(0.0, 0.3).shift == pytest.approx(0.3)


def test_samples_older_than_those_of_the_last_tick_are_excluded() -> None:
    made = even(1.0)
    made.add(stream([0.4], np.full((1, 3), 9.0), np.zeros(1)), np.arange(1))
    assert made.newest == pytest.approx(1.0)
    assert made.between(0.0, 1.0).shift == pytest.approx(1.0)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_samples_that_are_not_finite_are_excluded(value: float) -> None:
    made = even(1.0)
    made.add(stream([1.1, 1.2], np.array([[value, 0, 0], [1.0, 0, 0]]), np.zeros(2)), np.arange(2))
    assert made.between(0.0, 1.2).shift == pytest.approx(1.2)


def test_samples_of_others_are_not_taken_in() -> None:
    made = OdometryTrack()
    both = stream([0.1, 0.1], np.array([[1.0, 0, 0], [5.0, 0, 0]]), np.zeros(2))
    made.add(both, np.array([1]))
    assert made.between(0.0, 0.1).shift == pytest.approx(0.5)


def test_it_goes_on_when_its_room_is_full() -> None:
    made = OdometryTrack()
    n = 2 * CAPACITY + 1000
    time = np.linspace(0.01, 0.01 * n, n)
    forward: Array = np.column_stack([np.arange(n), np.zeros((n, 2))])
    for part in np.array_split(np.arange(n), 500):
        made.add(stream(time[part], forward[part], np.zeros(len(part))), np.arange(len(part)))
    assert made.newest == time[-1]
    motion = made.between(time[-CAPACITY // 2], time[-1])
    assert motion.shift == pytest.approx(0.01 * forward[-CAPACITY // 2 + 1 :, 0].sum())


def test_samples_beyond_capacity_keep_the_newest() -> None:
    made, n = OdometryTrack(), 2 * CAPACITY + 5
    made.add(stream(0.01 * np.arange(n), np.ones((n, 3)), np.zeros(n)), np.arange(n))
    assert made.newest == pytest.approx(0.01 * (n - 1))
    assert made.between(0.01 * (n - 101), made.newest).length == pytest.approx(math.sqrt(2))


def test_a_scale_stretches_and_turns_the_way() -> None:
    plain = even(1.0, (1.0, 0.0), 0.5).between(0.0, 1.0)
    scaled = even(1.0, (1.0, 0.0), 0.5).between(0.0, 1.0, scale=1.1 * np.exp(0.2j))
    assert scaled.shift == pytest.approx(plain.shift * 1.1 * np.exp(0.2j))
    assert scaled.length == pytest.approx(1.1)
    assert scaled.turn == plain.turn


def test_a_yaw_bias_is_taken_from_the_turn() -> None:
    biased = even(1.0, (1.0, 0.3), 0.5).between(0.0, 1.0, yaw_bias=0.1)
    right = even(1.0, (1.0, 0.3), 0.4).between(0.0, 1.0)
    assert biased.turn == pytest.approx(0.4)
    assert biased.shift == pytest.approx(right.shift)


def test_a_stance_is_the_sample_that_holds_then() -> None:
    made = OdometryTrack()
    table = Odometry(
        agent=np.zeros(2, int),
        time=np.array([0.1, 0.2]),
        velocity=np.array([[1.0, 2, 3], [4, 5, 6]]),
        yaw_rate=np.array([0.1, 0.2]),
        roll=np.array([0.3, 0.4]),
        pitch=np.array([0.5, 0.6]),
        height=np.array([0.7, 0.8]),
    )
    made.add(table, np.arange(2))
    roll, pitch, height, velocity, yaw_rate, tilt_rate, _ = made.at(0.15)
    assert (roll, pitch, height, yaw_rate) == (0.4, 0.6, 0.8, 0.2)
    assert tilt_rate == pytest.approx((1.0, 1.0))
    assert velocity.tolist() == [4, 5, 6]
    assert made.at(9.0).height == 0.8


def test_without_a_sample_it_stands_level_and_still() -> None:
    stance = OdometryTrack().at(1.0)
    assert (stance.roll, stance.pitch, stance.height, stance.yaw_rate) == (0, 0, 0, 0)
    assert not stance.velocity.any()


@given(samples, st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2, unique=True).map(sorted))
def test_a_corrected_way_is_the_one_that_was_measured(
    rows: list[tuple[float, float, float, float]], share: list[float]
) -> None:
    made = track(rows)
    begin, end = (s * made.newest for s in share)
    assume(end - begin > 1e-6)
    before, after = made.between(0.0, begin), made.between(end, made.newest)
    turn = made.between(begin, end).turn
    made.correct(begin, end, 0.3 - 0.1j, yaw_bias=0.0)
    motion = made.between(begin, end)
    assert motion.shift == pytest.approx(0.3 - 0.1j, abs=1e-9)
    assert motion.turn == pytest.approx(turn, abs=1e-9)
    assert made.between(0.0, begin).shift == pytest.approx(before.shift, abs=0.004)
    assert made.between(end, made.newest).shift == pytest.approx(after.shift, abs=0.004)


def test_corrections_apply_under_the_yaw_bias_they_assumed() -> None:
    made = even(1.0, (1.0, 0.0), 0.5)
    made.correct(0.2, 0.7, 0.4j, yaw_bias=0.1)
    assert made.between(0.2, 0.7, yaw_bias=0.1).shift == pytest.approx(0.4j)


def test_only_what_was_not_corrected_is_blind() -> None:
    made = even(1.0)
    made.correct(0.255, 0.755, 0.5 + 0j, yaw_bias=0.0)
    motion = made.between(0.0, 2.0)
    assert (motion.length, motion.duration) == pytest.approx((2.0, 2.0))
    assert (motion.blind_length, motion.blind_duration) == pytest.approx((1.5, 1.5))


def test_what_is_not_reported_yet_is_not_corrected() -> None:
    made = even(1.0)
    made.correct(0.5, 1.5, 9.0 + 0j, yaw_bias=0.0)
    assert made.between(0.0, 1.0).shift == pytest.approx(1.0)


def test_ways_are_corrected_when_its_room_is_full() -> None:
    made, n = OdometryTrack(), 2 * CAPACITY
    made.add(stream(0.01 * np.arange(n), np.ones((n, 3)), np.zeros(n)), np.arange(n))
    made.add(stream(0.01 * np.arange(n, 2 * n), np.ones((n, 3)), np.zeros(n)), np.arange(n))
    while made._end < len(made._rows):
        last = made.newest
        made.add(stream([last + 0.01], np.ones((1, 3)), np.zeros(1)), np.arange(1))
    end = made.newest
    made.correct(end - 1.005, end - 0.005, 0.25 + 0j, yaw_bias=0.0)
    assert made.between(end - 1.005, end - 0.005).shift == pytest.approx(0.25)


def test_positions_lag_behind_the_turns_of_a_biased_body() -> None:
    # A drone that hovers turns by 180° in 2 s. Its accelerometer errs by 0.15 m/s² ahead.
    bias, rate, time = 0.15, math.pi / 2, np.arange(1, 401) / 100

    def slope(t: float, state: Array) -> Array:
        velocity, tilt = state
        measured = bias * np.exp(1j * rate * min(t, 2.0))
        return np.array([tilt + measured - VELOCITY_CORRECTION * velocity,
                         -TILT_CORRECTION * velocity])  # fmt: skip

    solved = solve_ivp(slope, (0, 4), np.array([0j, -bias]), t_eval=time, rtol=1e-9, atol=1e-12)
    heading = np.exp(-1j * rate * np.minimum(time - 0.005, 2.0))
    body = heading * solved.y[0]
    velocity = np.column_stack([body.real, body.imag, np.zeros(400)])
    made = OdometryTrack()
    made.add(stream(time, velocity, np.where(time <= 2.0, rate, 0.0)), np.arange(400))
    anchor = start(Agent("cf1", (0.0, 0.0, 0.0), uri="sim"))
    anchor.mean[ARM_X] = bias / TILT_CORRECTION
    errors = [np.hypot(*predict(anchor, t, made, 0.0).position[:2]) for t in (1.0, 2.0, 3.0, 4.0)]
    assert max(errors) < 0.003  # without the lag 0.04, 0.07, 0.03 and 0.01
