"""Rays of points, and their derivatives."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from star_apriltag.vision.perspective import perspective
from star_core import Array

points = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.5, 3)).map(np.array)


@given(points)
def test_the_derivative_of_a_ray_is_that_of_differences(point: Array) -> None:
    _, derivative = perspective(point)
    for k, step in enumerate(1e-6 * np.eye(3)):
        difference = perspective(point + step)[0] - perspective(point - step)[0]
        np.testing.assert_allclose(derivative[:, k], difference / 2e-6, atol=1e-7)
