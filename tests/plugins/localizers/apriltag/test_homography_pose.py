"""The pose of a square from its homography."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_apriltag.batch import homography_pose
from star_core import Array, Pose
from star_core.toolkit import rotation_from_vector, square_corners

FACING = np.diag([1.0, -1.0, -1.0])  # the square's z axis towards the camera
angle = st.floats(-0.9, 0.9)
SIZE = 0.168


def rays(pose: Pose) -> Array:
    ahead = pose.apply(square_corners(SIZE))
    directions: Array = ahead[:, :2] / ahead[:, 2:]
    return directions


@given(angle, angle, angle, st.floats(-0.5, 0.5), st.floats(0.4, 2.0))
def test_exact_corners_give_the_exact_pose(
    roll: float, pitch: float, yaw: float, aside: float, ahead: float
) -> None:
    pose = Pose(
        FACING @ rotation_from_vector(np.array([roll, pitch, yaw])),
        np.array([aside, -aside, ahead]),
    )
    estimate = homography_pose(rays(pose), SIZE)
    assert estimate is not None
    assert estimate.position == pytest.approx(pose.position, abs=1e-8)
    assert estimate.rotation == pytest.approx(pose.rotation, abs=1e-7)


def test_what_it_gives_for_corners_that_err_is_a_rotation() -> None:
    pose = Pose(FACING @ rotation_from_vector(np.array([0.3, 0.1, 0.2])), np.array([0.1, 0.0, 1.2]))
    estimate = homography_pose(rays(pose) + np.random.default_rng(0).normal(0, 0.002, (4, 2)), SIZE)
    assert estimate is not None
    assert estimate.rotation @ estimate.rotation.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(estimate.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "bad", [np.full((4, 2), np.nan), np.zeros((4, 2)), np.repeat([[0.1, 0.2]], 4, axis=0)]
)
def test_corners_that_are_no_square_have_no_pose(bad: Array) -> None:
    assert homography_pose(bad, SIZE) is None
