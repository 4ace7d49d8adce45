import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from star_core import Array
from star_core.toolkit import compiled, polynomial, transformed

coefficients = arrays(np.float64, (4, 8), elements=st.floats(-2, 2, allow_subnormal=False))


@given(coefficients, st.floats(-2, 2))
def test_a_piece_is_evaluated_as_numpy_does(piece: Array, time: float) -> None:
    for axis, *derivatives in zip(piece, *polynomial(piece.T, time), strict=True):
        reference = np.polynomial.Polynomial(axis)
        expected = [reference(time), reference.deriv()(time), reference.deriv(2)(time)]
        assert derivatives == pytest.approx(expected, rel=1e-9, abs=1e-9)
        assert polynomial(axis.tolist(), time) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_kernel_evaluates_it_alike() -> None:
    axis = np.arange(8.0)
    assert compiled(polynomial)(axis, 0.7) == pytest.approx(polynomial(axis, 0.7))


@given(coefficients, st.floats(-3, 3), st.floats(0, 1))
def test_a_piece_in_another_frame_is_turned_and_shifted(
    piece: Array, yaw: float, time: float
) -> None:
    x, y, z, heading = polynomial(piece.T, time)[0]
    moved = polynomial(transformed(piece, yaw, [1.0, 2.0, 3.0]).T, time)[0]
    turned = complex(x, y) * complex(math.cos(yaw), math.sin(yaw))
    expected = [turned.real + 1, turned.imag + 2, z + 3, heading + yaw]
    assert moved == pytest.approx(expected, abs=1e-9)
