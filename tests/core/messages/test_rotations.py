import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from star_core import Array, Pose
from star_core.toolkit import (
    quaternion_from_euler,
    rotation_from_quaternion,
    rotation_from_vector,
    skew,
    wrap_angle,
)

vectors = arrays(np.float64, 3, elements=st.floats(-4, 4, allow_subnormal=False))
poses = st.builds(lambda v, p: Pose(Rotation.from_rotvec(v).as_matrix(), p), vectors, vectors)


@given(vectors)
def test_a_turn_is_that_of_its_rotation_vector(vector: Array) -> None:
    np.testing.assert_allclose(
        rotation_from_vector(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12
    )


@given(vectors)
def test_a_quaternion_and_its_matrix_turn_alike(vector: Array) -> None:
    rotation = Rotation.from_rotvec(vector)
    x, y, z, w = rotation.as_quat().tolist()
    np.testing.assert_allclose(
        rotation_from_quaternion((x, y, z, w)), rotation.as_matrix(), atol=1e-12
    )


@given(vectors, vectors)
def test_the_matrix_of_a_cross_product_takes_it(a: Array, b: Array) -> None:
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-12)


@given(poses, poses, vectors)
def test_poses_chain(outer: Pose, inner: Pose, point: Array) -> None:
    np.testing.assert_allclose(
        (outer @ inner).apply(point), outer.apply(inner.apply(point)), atol=1e-9
    )


@given(poses, vectors)
def test_a_pose_and_its_inverse_cancel_out(pose: Pose, point: Array) -> None:
    np.testing.assert_allclose(pose.inverse().apply(pose.apply(point)), point, atol=1e-9)


def test_a_pose_is_moved_in_its_own_frame() -> None:
    quarter = np.pi / 2
    left = Pose(rotation_from_vector(np.array([0, 0, quarter])), np.zeros(3))
    moved = left.moved(np.array([0, 0, quarter, 1.0, 0, 0]))
    np.testing.assert_allclose(moved.position, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(abs(moved.yaw), np.pi)


@given(vectors)
def test_a_quaternion_is_that_of_its_euler_angles(angles: Array) -> None:
    made = rotation_from_quaternion(quaternion_from_euler(*angles))
    np.testing.assert_allclose(made, Rotation.from_euler("xyz", angles).as_matrix(), atol=1e-12)


@given(st.floats(-1e3, 1e3))
def test_a_wrapped_angle_is_the_same_angle_within_half_a_turn(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -np.pi <= wrapped < np.pi
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angle), atol=1e-9)
