import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from star_apriltag.vision.rigid import Pose, cross, matrix, turn
from star_core import Array

vectors = arrays(np.float64, 3, elements=st.floats(-4, 4, allow_subnormal=False))
poses = st.builds(lambda v, p: Pose(Rotation.from_rotvec(v).as_matrix(), p), vectors, vectors)


@given(vectors)
def test_a_turn_is_that_of_its_rotation_vector(vector: Array) -> None:
    np.testing.assert_allclose(turn(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)


@given(vectors)
def test_a_quaternion_and_its_matrix_turn_alike(vector: Array) -> None:
    rotation = Rotation.from_rotvec(vector)
    x, y, z, w = rotation.as_quat().tolist()
    np.testing.assert_allclose(matrix((x, y, z, w)), rotation.as_matrix(), atol=1e-12)


@given(vectors, vectors)
def test_the_matrix_of_a_cross_product_takes_it(a: Array, b: Array) -> None:
    np.testing.assert_allclose(cross(a) @ b, np.cross(a, b), atol=1e-12)


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
    left = Pose(turn(np.array([0, 0, quarter])), np.zeros(3))
    moved = left.moved(np.array([0, 0, quarter, 1.0, 0, 0]))
    np.testing.assert_allclose(moved.position, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(abs(moved.yaw), np.pi)
