"""Tables of every type name the field whose number of rows differs, or whose rows have no shape."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from star_core import (
    ContractError,
    Corrections,
    Estimate,
    Frames,
    Goals,
    Odometry,
    Paths,
    Plan,
    Setpoint,
    Sightings,
    Telemetry,
    Trajectory,
    Transform,
)
from star_core.messages.arrays import frozen


def rows(n: int, *shape: int) -> np.ndarray:
    return np.zeros((n, *shape))


def setpoint(velocity: int, yaw: int, active: int) -> Setpoint:
    return Setpoint(rows(velocity, 3), rows(yaw), rows(active) > 0)


def estimate(n: int) -> Estimate:
    still = Transform(rows(2), rows(2, 3))
    return Estimate(0.0, rows(n, 3), rows(2, 3), rows(2), rows(2, 3, 3), rows(2) > 0, still)


def telemetry(**more: Any) -> Telemetry:
    return Telemetry(0.0, rows(2, 3), rows(2, 3), rows(2, 4), rows(2), INTEGERS, rows(2), **more)


INTEGERS = np.zeros(2, np.int64)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: setpoint(1, 2, 3),
         "Setpoint.velocity has 1 row, yaw has 2 rows, but active has 3; expected one row per "
         "agent [wrong-shape]"),
        (lambda: estimate(1),
         "Estimate.position has 1 row, but velocity, yaw, covariance, valid, possible_travel and "
         "map_from_odom have 2; expected one row per agent [wrong-shape]"),
        (lambda: telemetry(signal=rows(1)),
         "Telemetry.signal has 1 row, but position, velocity, attitude, battery, state and age "
         "have 2; expected one row per agent [wrong-shape]"),
        (lambda: Frames(INTEGERS, rows(2), rows(2), ()),
         "Frames.image has 0 rows, but agent, taken and arrived have 2; expected one row per "
         "image [wrong-shape]"),
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
        (1.0, "Setpoint.velocity has shape (), expected (N, 3) [contract-broken]"),
        (None, "Setpoint.velocity has shape (), expected (N, 3) [contract-broken]"),
    ],
)
def test_a_table_names_the_field_whose_rows_have_another_shape(velocity: Any, message: str) -> None:
    with pytest.raises(ContractError) as caught:
        Setpoint(velocity, rows(2), rows(2) > 0)
    assert str(caught.value) == message


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
    for column_spec in kind.COLUMNS:
        column = getattr(empty, column_spec.name)
        if column_spec.optional:
            assert column is None
        else:
            assert (column.shape, column.dtype) == ((2, *column_spec.row), column_spec.dtype)


@pytest.mark.parametrize(
    ("velocity", "elements"),
    [
        (np.ones((2, 3)) * 1j, "complex128"),
        (np.ones((2, 3)).astype(str), "str"),
        ([["1", "2", "3"]] * 2, "str"),
        (np.zeros((2, 3), "datetime64[s]"), "datetime64"),
    ],
)
def test_arrays_that_are_no_numbers_are_refused(velocity: Any, elements: str) -> None:
    with pytest.raises(ContractError) as caught:
        Setpoint(velocity, rows(2), rows(2) > 0)
    text = f"Setpoint.velocity is an array of {elements}, expected float64 [contract-broken]"
    assert str(caught.value) == text


@pytest.mark.parametrize("dtype", [np.float32, np.int8, np.uint64, np.bool_, object])
def test_arrays_of_numbers_are_converted(dtype: Any) -> None:
    made = Setpoint(np.ones((2, 3), dtype), rows(2), rows(2) > 0)
    assert made.velocity.dtype == np.float64
    assert made.velocity.tolist() == [[1.0] * 3] * 2
