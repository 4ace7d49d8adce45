"""Motions of scripts, and the trajectories that they evaluate."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Array
from star_script.motions import Flown, GoTo, Hold, Motion, State, Steered, Streamed
from star_script.uav_trajectory import Polynomial4D, Trajectory

START = State(np.array([1.0, 2, 0.5]), np.array([0.3, 0, 0]), np.array([0.1, 0, 0]), 3.0, 0.0)
RNG = np.random.default_rng(4)
PIECES = [(1.0, RNG.uniform(-0.5, 0.5, (4, 8))), (0.7, RNG.uniform(-0.5, 0.5, (4, 8)))]


def flown(*, reverse: bool = False, relative: bool = False, timescale: float = 1.0) -> Flown:
    return Flown(
        PIECES, START, 2.0, timescale=timescale, reverse=reverse, relative=relative, line="a.py:1"
    )


def numeric(motion: Motion, time: float) -> tuple[Array, Array]:
    """Velocity and acceleration from differences."""
    step = 1e-4
    before, now, after = (motion.at(time + k * step) for k in (-1, 0, 1))
    velocity = (after.position - before.position) / (2 * step)
    return velocity, (after.position - 2 * now.position + before.position) / step**2


def test_a_go_to_begins_as_it_was_and_ends_at_rest() -> None:
    motion = GoTo(START, np.array([2.0, 2, 1]), -3.0, 10.0, 2.0, "a.py:1")
    begin, end = motion.at(10.0), motion.at(12.0 - 1e-9)
    for part, expected in zip(begin[:3], START[:3], strict=True):
        assert part == pytest.approx(expected)
    assert end.position == pytest.approx([2, 2, 1])
    assert end.velocity == pytest.approx([0, 0, 0], abs=1e-6)
    assert end.acceleration == pytest.approx([0, 0, 0], abs=1e-6)
    assert end.yaw == pytest.approx(-3.0 + 2 * np.pi)  # the shorter way
    assert np.isnan(motion.at(12.5).acceleration).all()


@pytest.mark.parametrize(
    "motion",
    [
        GoTo(START, np.array([2.0, 2, 1]), -3.0, 2.0, 1.7, "a.py:1"),
        flown(),
        flown(reverse=True, timescale=1.5),
        flown(relative=True, timescale=0.7),
        Streamed(START, 2.0, "a.py:1"),
    ],
)
def test_velocities_and_accelerations_are_those_of_the_positions(motion: Motion) -> None:
    for time in (2.1, 2.3, 2.45):
        state = motion.at(time)
        velocity, acceleration = numeric(motion, time)
        assert state.velocity == pytest.approx(velocity, abs=1e-5)
        assert state.acceleration == pytest.approx(acceleration, abs=1e-3)


def test_a_reversed_trajectory_ends_where_it_begins() -> None:
    forth, back = flown(), flown(reverse=True)
    assert forth.at(2.0).position == pytest.approx(back.at(back.end).position)
    assert forth.at(forth.end).position == pytest.approx(back.at(2.0).position)


def test_a_relative_trajectory_begins_at_the_state_before() -> None:
    assert flown(relative=True).at(2.0).position == pytest.approx(START.position)


def test_setpoints_turn_velocities_with_the_body() -> None:
    motion = Steered(
        np.zeros(3), np.array([0.4, 0, 0]), np.pi / 2, 0.0, 1.0, "a.py:1", height=1.0, in_body=True
    )
    assert motion.at(1.1).velocity == pytest.approx([0, 0.4, 0], abs=1e-9)
    assert motion.at(1.2).position == pytest.approx([0, 0.08, 0], abs=1e-9)


def test_a_hold_stays() -> None:
    state = Hold(np.ones(3), 0.3).at(7.0)
    assert (state.position.tolist(), state.yaw, state.velocity.tolist()) == ([1] * 3, 0.3, [0] * 3)


def test_trajectories_evaluate_like_their_polynomials() -> None:
    trajectory = Trajectory()
    trajectory.polynomials = [Polynomial4D(d, *c) for d, c in PIECES]
    trajectory.duration = 1.7
    assert trajectory.n_pieces() == 2
    for time in (0.2, 0.9, 1.5):
        state, other = trajectory.eval(time), flown().at(2.0 + time)
        assert state.pos == pytest.approx(other.position)
        assert state.vel == pytest.approx(other.velocity)
        assert state.acc == pytest.approx(other.acceleration)
        assert state.yaw == pytest.approx(other.yaw)
    derived = trajectory.polynomials[0].derivative()
    assert derived.eval(0.4).pos == pytest.approx(trajectory.eval(0.4).vel)
    with pytest.raises(ValueError, match="outside of the trajectory"):
        trajectory.eval(2.0)


def test_attitude_and_rates_are_those_of_a_drone_that_flies_it() -> None:
    turning = np.zeros((4, 8))
    turning[3, 1] = 0.5
    hover = Polynomial4D(1.0, *turning).eval(0.3)
    assert hover.omega == pytest.approx([0, 0, 0.5])
    assert hover.roll == pytest.approx(0)
    assert hover.pitch == pytest.approx(0)
    ahead = np.zeros((4, 8))
    ahead[0, 2] = 9.81 / 2  # 1 g ahead: nose down by 45 degrees
    state = Polynomial4D(1.0, *ahead).eval(0.3)
    assert state.pitch == pytest.approx(np.pi / 4)
    assert state.omega == pytest.approx([0, 0, 0])
    jerking = np.zeros((4, 8))
    jerking[0, 3] = 1.0  # a jerk of 6 m/s³ ahead pitches the nose down
    assert Polynomial4D(1.0, *jerking).eval(0.0).omega[1] == pytest.approx(6 / 9.81)
