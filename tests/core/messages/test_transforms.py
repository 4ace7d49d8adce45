"""Frames: the laws of a transform, and flights whose odometry frames do not lie in the map."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import Array, Command, ContractError, Order, Setpoint, Transform
from tests.core.conftest import Lab

angles = st.floats(-20.0, 20.0)
metres = st.floats(-1e3, 1e3)
CLOSE = 1e-9  # m, of points up to 1 km away


def points(n: int) -> st.SearchStrategy[Array]:
    rows = st.lists(st.tuples(metres, metres, metres), min_size=n, max_size=n)
    return rows.map(lambda drawn: np.array(drawn).reshape(n, 3))


def transforms(n: int) -> st.SearchStrategy[Transform]:
    return st.builds(Transform, st.lists(angles, min_size=n, max_size=n).map(np.array), points(n))


@given(transforms(3), points(3))
def test_the_inverse_undoes_a_motion(motion: Transform, where: Array) -> None:
    assert motion.inverse().apply(motion.apply(where)) == pytest.approx(where, abs=CLOSE)
    assert motion.apply(motion.inverse().apply(where)) == pytest.approx(where, abs=CLOSE)


@given(transforms(2), transforms(2), points(2))
def test_two_motions_in_a_row_are_one(first: Transform, second: Transform, where: Array) -> None:
    both = Transform(first.yaw + second.yaw, second.apply(first.translation))
    assert second.apply(first.apply(where)) == pytest.approx(both.apply(where), abs=CLOSE)


@given(transforms(2), points(2))
def test_turning_back_undoes_turning(motion: Transform, vectors: Array) -> None:
    turned = motion.turn(vectors)
    assert motion.turn_back(turned) == pytest.approx(vectors, abs=CLOSE)
    assert turned[:, 2].tolist() == vectors[:, 2].tolist()


@given(transforms(3), points(3))
def test_each_row_is_moved_by_its_own_motion(motion: Transform, where: Array) -> None:
    rows = np.array([2, 0])
    assert motion.of(rows).apply(where[rows]) == pytest.approx(motion.apply(where)[rows])


def test_a_quarter_turn_takes_x_to_y() -> None:
    quarter = Transform(np.array([math.pi / 2]), np.array([[1.0, 2.0, 3.0]]))
    assert quarter.apply(np.array([[1.0, 0.0, 0.0]])) == pytest.approx(np.array([[1.0, 3.0, 3.0]]))


def test_vectors_that_are_turned_stay_as_they_were() -> None:
    vectors = np.array([[1.0, 0.0, 0.0]])
    Transform(np.ones(1), np.ones((1, 3))).turn(vectors)
    assert vectors.tolist() == [[1.0, 0.0, 0.0]]


def test_a_transform_refuses_rows_that_do_not_match() -> None:
    with pytest.raises(ContractError) as caught:
        Transform(np.zeros(2), np.zeros((3, 3)))
    assert str(caught.value) == (
        "Transform.yaw has 2 rows, but translation has 3; expected one row per agent [wrong-shape]"
    )


# Flights: both odometry frames are turned a quarter to the left of the map and lie 0.3 m higher.

ASKEW = Transform(np.full(2, math.pi / 2), np.array([[1.0, 2.0, 0.3], [1.0, 4.0, 0.3]]))
ALONG_X = """
  - climb: {}
  - visit: {agents: cf1, to: [3, 2, 1], yaw_deg: 180}
  - descend: {}
"""
BY_ITSELF = """
  - climb: {}
  - ride: {agents: cf1, to: [3, 2, 1], yaw_deg: 90}
  - wait: {seconds: 1}
"""


def askew(lab: Lab, steps: str) -> None:
    lab.frames = ASKEW
    assert lab.fly(steps)["outcome"] == "completed"


def flown_along_x(lab: Lab) -> tuple[Setpoint, Setpoint]:
    """Return one setpoint as the transport had it and as it was recorded."""
    tick = next(tick for tick in lab.ticks if tick.doing == "visit cf1")
    return dict(lab.robots.sent)[tick.time], tick.sent


def given_order(lab: Lab, order: Order) -> Command:
    return next(command for _, command in lab.robots.commands if command.order is order)


def test_velocities_and_headings_are_sent_in_each_odometry_frame(lab: Lab) -> None:
    askew(lab, ALONG_X)
    sent, _ = flown_along_x(lab)
    assert sent.velocity[0] == pytest.approx([0.0, -0.5, 0.0])  # x of the map is -y of the frame
    assert sent.yaw[0] == pytest.approx(math.pi / 2)


def test_what_was_sent_is_recorded_in_the_map(lab: Lab) -> None:
    askew(lab, ALONG_X)
    _, recorded = flown_along_x(lab)
    assert recorded.velocity[0] == pytest.approx([0.5, 0.0, 0.0])
    assert recorded.yaw[0] == pytest.approx(math.pi)


def test_what_a_transport_limits_is_recorded_in_the_map(lab: Lab) -> None:
    lab.spoil(
        "transport",
        "send",
        lambda right, s: right(replace(s, velocity=0.5 * s.velocity, yaw=[0, 0])),
    )
    askew(lab, ALONG_X)
    _, recorded = flown_along_x(lab)
    assert recorded.velocity[0] == pytest.approx([0.25, 0.0, 0.0])
    assert recorded.yaw[0] == pytest.approx(math.pi / 2)


def test_agents_arrive_at_positions_in_the_map(lab: Lab) -> None:
    askew(lab, ALONG_X)
    tick = lab.ticks[-1]
    assert tick.truth is not None
    position = tick.truth.position[:, :2]
    assert position == pytest.approx(np.array([[3.0, 2.0], [1.0, 4.0]]))


def test_places_to_fly_to_are_commanded_in_each_odometry_frame(lab: Lab) -> None:
    askew(lab, BY_ITSELF)
    command = given_order(lab, Order.GOTO)
    assert command.position == pytest.approx(np.array([[0.0, -2.0, 0.7]]))
    assert command.yaw == pytest.approx([0.0])


def test_climb_heights_are_commanded_in_each_odometry_frame(lab: Lab) -> None:
    askew(lab, BY_ITSELF)
    assert given_order(lab, Order.TAKEOFF).position[:, 2] == pytest.approx([0.7, 0.7])


def test_the_core_lands_just_below_the_floor_of_the_map(lab: Lab) -> None:
    askew(lab, BY_ITSELF)
    landings = [command for _, command in lab.robots.commands if command.order is Order.LAND]
    assert [z for landing in landings for z in landing.position[:, 2]] == pytest.approx(
        [-0.45, -0.45]
    )


def test_orders_are_transformed_to_the_frames_of_their_agents(lab: Lab) -> None:
    lab.frames = replace(ASKEW, yaw=np.array([math.pi / 2, math.pi]))
    lab.fly("\n  - climb: {}\n  - ride: {agents: cf2, to: [3, 4, 1], yaw_deg: 90}")
    command = given_order(lab, Order.GOTO)
    assert command.agent.tolist() == [1]
    assert command.position == pytest.approx(np.array([[-2.0, 0.0, 0.7]]))
    assert command.yaw == pytest.approx([-math.pi / 2])
