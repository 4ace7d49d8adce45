"""By how much uncertain positions enlarge distances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from star_core import Array
from star_core.toolkit import position_margin, yielding_margin


def unsure(spread: Array, turn: float = 0.0) -> Array:
    """(1, 3, 3) covariance with these standard deviations along x, y and z, turned about z."""
    turned = Rotation.from_euler("z", turn).as_matrix()
    covariance: Array = (turned @ np.diag(np.square(spread)) @ turned.T)[None]
    return covariance


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 2, 2.0])
def test_margin_is_the_greatest_horizontal_uncertainty(turn: float) -> None:
    covariance = unsure(np.array([0.05, 0.02, 0.9]), turn)
    assert position_margin(covariance, 2.0, 0.2) == pytest.approx([0.1])


@pytest.mark.parametrize("value", [1.0, np.inf, np.nan])
def test_margin_is_limited_also_for_nonfinite_covariance(value: float) -> None:
    assert position_margin(np.full((1, 3, 3), value), 2.0, 0.2) == pytest.approx([0.4])


@pytest.mark.parametrize("value", [1.0, np.nan])
def test_positions_that_are_exact_have_no_margin(value: float) -> None:
    assert position_margin(np.full((1, 3, 3), value), 0.0, 0.2).tolist() == [0.0]


def test_a_margin_leaves_some_room_wherever_there_is_some() -> None:
    room = np.array([-0.3, 0.0, 0.01, 0.1, 1.0])
    left = room - yielding_margin(np.full(5, 0.4), room, 2.0)
    assert left.tolist() == pytest.approx([-0.3, 0.0, 0.004, 0.04, 0.6])
