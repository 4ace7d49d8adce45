import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from star_core.toolkit import square_corners, square_poses

SIZE = 0.168


@given(
    st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(0.6, 1.5)),
    st.tuples(st.floats(0.02, 0.5), st.floats(-0.5, 0.5), st.floats(-3, 3)),  # OpenCV may fail at 0
)
def test_a_square_is_found_where_it_is(
    centre: tuple[float, float, float], turn: tuple[float, float, float]
) -> None:
    facing = Rotation.from_euler("x", np.pi) * Rotation.from_euler("xyz", turn)
    points = facing.apply(square_corners(SIZE)) + centre
    noise = np.random.default_rng(0).normal(0.0, 1e-5, (4, 2))
    pose, residual = square_poses(points[:, :2] / points[:, 2:] + noise, SIZE)[0]
    assert residual < 1e-4
    assert pose.position == pytest.approx(centre, abs=2e-3)


def test_a_square_that_is_seen_from_behind_has_no_pose() -> None:
    points = square_corners(SIZE) + np.array([0.0, 0.0, 1.0])
    assert square_poses(points[:, :2] / points[:, 2:], SIZE) == []
