"""Tables of every type name the field whose number of rows differs, or whose rows have no shape."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from star_core import (
    Command,
    ContractError,
    Corrections,
    Detections,
    Estimate,
    Frames,
    Goals,
    Health,
    Odometry,
    Order,
    Paths,
    Plan,
    Setpoint,
    Sightings,
    Telemetry,
    Trajectory,
    Transform,
    Truth,
)
from star_core.messages.arrays import frozen


def rows(n: int, *shape: int) -> np.ndarray:
    return np.zeros((n, *shape))


def setpoint(velocity: int = 2, yaw: int = 2, active: int = 2) -> Setpoint:
    return Setpoint(rows(velocity, 3), rows(yaw), rows(active) > 0)


def estimate(n: int) -> Estimate:
    still = Transform(rows(2), rows(2, 3))
    return Estimate(0.0, rows(n, 3), rows(2, 3), rows(2), rows(2, 3, 3), rows(2) > 0, still)


def telemetry(n: int, **more: Any) -> Telemetry:
    state = np.zeros(2, np.int64)
    return Telemetry(0.0, rows(2, 3), rows(2, 3), rows(n, 4), rows(2), state, rows(2), **more)


INTEGERS = np.zeros(2, np.int64)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: setpoint(velocity=1),
         "Setpoint.velocity has 1 row, but yaw and active have 2; expected one row per agent"
         " [wrong-shape]"),
        (lambda: setpoint(yaw=3),
         "Setpoint.yaw has 3 rows, but velocity and active have 2; expected one row per agent"
         " [wrong-shape]"),
        (lambda: setpoint(1, 2, 3),
         "Setpoint.velocity has 1 row, yaw has 2 rows, but active has 3; expected one row per "
         "agent [wrong-shape]"),
        (lambda: estimate(1),
         "Estimate.position has 1 row, but velocity, yaw, covariance, valid, possible_travel and "
         "map_from_odom have 2; expected one row per agent [wrong-shape]"),
        (lambda: Goals(rows(2, 3), rows(2, 3), rows(2), rows(1), rows(2) > 0),
         "Goals.speed has 1 row, but position, velocity, yaw and active have 2; expected one row "
         "per agent [wrong-shape]"),
        (lambda: Plan(setpoint(), Paths(rows(0), rows(0, 3)), rows(3) > 0),
         "Plan.unreachable has 3 rows, but setpoint has 2; expected one row per agent"
         " [wrong-shape]"),
        (lambda: Health(INTEGERS, rows(2), rows(0)),
         "Health.age has 0 rows, but phase and battery have 2; expected one row per agent"
         " [wrong-shape]"),
        (lambda: Transform(rows(2), rows(1, 3)),
         "Transform.yaw has 2 rows, but translation has 1; expected one row per agent"
         " [wrong-shape]"),
        (lambda: Truth(0.0, rows(2, 3), rows(1, 3), rows(2, 4)),
         "Truth.velocity has 1 row, but position and attitude have 2; expected one row per agent"
         " [wrong-shape]"),
        (lambda: telemetry(1),
         "Telemetry.attitude has 1 row, but position, velocity, battery, state and age have 2; "
         "expected one row per agent [wrong-shape]"),
        (lambda: telemetry(2, signal=rows(1)),
         "Telemetry.signal has 1 row, but position, velocity, attitude, battery, state and age "
         "have 2; expected one row per agent [wrong-shape]"),
        (lambda: Paths(INTEGERS, rows(1, 3)),
         "Paths.agent has 2 rows, but point has 1; expected one row per point [wrong-shape]"),
        (lambda: Odometry(INTEGERS, rows(2), rows(2, 3), rows(2), rows(2), rows(1), rows(2)),
         "Odometry.pitch has 1 row, but agent, time, velocity, yaw_rate, roll and height have 2; "
         "expected one row per sample [wrong-shape]"),
        (lambda: Frames(INTEGERS, rows(2), rows(2), ()),
         "Frames.image has 0 rows, but agent, taken and arrived have 2; expected one row per "
         "image [wrong-shape]"),
        (lambda: Detections(INTEGERS, INTEGERS, rows(1, 4, 2), rows(2), rows(2)),
         "Detections.corners has 1 row, but agent, tag, taken and arrived have 2; expected one row "
         "per tag [wrong-shape]"),
        (lambda: Sightings(INTEGERS, INTEGERS, rows(2), rows(2, 3), rows(1), rows(2, 3, 3)),
         "Sightings.yaw has 1 row, but agent, tag, time, position and covariance have 2; expected "
         "one row per tag [wrong-shape]"),
        (lambda: Corrections(INTEGERS, rows(2, 3), rows(2, 4), rows(1), rows(2)),
         "Corrections.position_deviation has 1 row, but agent, position, attitude and "
         "attitude_deviation have 2; expected one row per correction [wrong-shape]"),
        (lambda: Command(Order.LAND, INTEGERS, rows(1, 3), rows(2), rows(2) + 1),
         "Command.position has 1 row, but agent, yaw and duration have 2; expected one row per "
         "agent commanded [wrong-shape]"),
        (lambda: Trajectory(rows(2) + 1, rows(1, 4, 8)),
         "Trajectory.duration has 2 rows, but coefficients has 1; expected one row per piece"
         " [wrong-shape]"),
    ],
)  # fmt: skip
def test_tables_name_the_field_with_a_different_row_count(make: Any, message: str) -> None:
    with pytest.raises(ContractError) as caught:
        make()
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("velocity", "message"),
    [
        (rows(2), "Setpoint.velocity has shape (2,), expected (2, 3) [contract-broken]"),
        (rows(2, 2), "Setpoint.velocity has shape (2, 2), expected (2, 3) [contract-broken]"),
        (1.0, "Setpoint.velocity has shape (), expected (N, 3) [contract-broken]"),
        (None, "Setpoint.velocity has shape (), expected (N, 3) [contract-broken]"),
    ],
)
def test_a_table_names_the_field_whose_rows_have_another_shape(velocity: Any, message: str) -> None:
    with pytest.raises(ContractError) as caught:
        Setpoint(velocity, rows(2), rows(2) > 0)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("counts", "message"),
    [
        ((1, 2, 2), "velocity has 1 row, but yaw and active have 2"),
        ((1, 2, 1), "yaw has 2 rows, but velocity and active have 1"),
        ((1, 2, 3), "velocity has 1 row, yaw has 2 rows, but active has 3"),
    ],
)
def test_fields_with_other_numbers_of_rows_are_named(
    counts: tuple[int, int, int], message: str
) -> None:
    with pytest.raises(ContractError) as caught:
        setpoint(*counts)
    assert str(caught.value) == f"Setpoint.{message}; expected one row per agent [wrong-shape]"


def test_rows_that_are_no_agents_are_named_as_what_they_are() -> None:
    with pytest.raises(ContractError) as caught:
        Paths(INTEGERS, rows(1, 3))
    text = "Paths.agent has 2 rows, but point has 1; expected one row per point [wrong-shape]"
    assert str(caught.value) == text


def test_a_table_takes_a_frozen_array_as_it_is() -> None:
    velocity, yaw = frozen(rows(2, 3)), rows(2)
    made = Setpoint(velocity, yaw, rows(2) > 0)
    assert made.velocity is velocity
    assert made.yaw is not yaw


@pytest.mark.parametrize("base", [np.zeros((4, 3)), np.zeros((2, 6))[:, ::2], np.zeros((3, 2)).T])
def test_a_view_is_copied_since_its_base_can_be_written_to(base: np.ndarray) -> None:
    view = base[:2]
    view.flags.writeable = False
    made = Setpoint(view, rows(2), rows(2) > 0)
    assert made.velocity.base is None
    assert made.velocity.flags.c_contiguous


@pytest.mark.parametrize("kind", [Goals, Setpoint, Plan, Corrections, Sightings, Paths, Odometry])
def test_a_table_of_no_rows_has_the_declared_shapes(kind: Any) -> None:
    empty = kind.none(2)
    for one in kind.COLUMNS:
        column = getattr(empty, one.name)
        if one.optional:
            assert column is None
        else:
            assert (column.shape, column.dtype) == ((2, *one.row), one.dtype)
