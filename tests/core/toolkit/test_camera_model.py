import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import Camera
from star_core.toolkit import CameraModel

LENS = CameraModel(Camera())
columns, rows = st.floats(30, 323), st.floats(30, 243)


def test_points_are_seen_where_opencv_sees_them() -> None:
    points = np.random.default_rng(0).uniform([-1, -1, 1], [1, 1, 3], (50, 3))
    still = np.zeros(3)
    expected, _ = cv2.projectPoints(
        points, still, still, LENS.matrix, np.array(Camera().distortion)
    )
    np.testing.assert_allclose(LENS.project(points), expected[:, 0], atol=1e-9)


@given(columns, rows)
def test_a_ray_is_seen_at_its_pixel(u: float, v: float) -> None:
    ray = LENS.undistort(np.array([u, v]))
    np.testing.assert_allclose(LENS.project(np.append(ray, 1.0)), [u, v], atol=1e-4)


@given(columns, rows)
def test_the_magnification_is_how_much_pixels_move_with_rays(u: float, v: float) -> None:
    ray = LENS.undistort(np.array([u, v]))
    step = 1e-5
    ahead = [LENS.project(np.append(ray + d, 1.0)) for d in step * np.eye(2)]
    pixel = LENS.project(np.append(ray, 1.0))
    stretched = np.linalg.det(np.stack([(p - pixel) / step for p in ahead]))
    assert LENS.magnification(ray) == pytest.approx(math.sqrt(stretched), rel=0.02)


def test_pixels_beyond_the_reach_of_the_lens_have_no_ray() -> None:
    inside, outside = LENS.undistort(np.array([[20.0, 20.0], [0.0, 0.0]]))
    assert np.isfinite(inside).all()
    assert np.isnan(outside).all()


def test_a_lens_without_distortion_reaches_everywhere() -> None:
    straight = CameraModel(Camera(distortion=(0.0, 0.0, 0.0, 0.0, 0.0)))
    far = np.array([1e4, -1e4])
    np.testing.assert_allclose(straight.project(np.append(straight.undistort(far), 1.0)), far)


def test_no_pixel_is_no_ray() -> None:
    assert LENS.undistort(np.zeros((0, 4, 2))).shape == (0, 4, 2)


def test_the_middle_row_is_read_half_a_readout_after_the_first() -> None:
    delay = LENS.row_delay(np.array([[5.0, 0.0], [9.0, 121.5], [0.0, 243.0]]))
    np.testing.assert_allclose(delay, [-0.015, 0.0, 0.015], atol=1e-12)


def test_a_camera_pitched_down_looks_ahead_and_down() -> None:
    mounting = LENS.mounting.rotation
    root = math.sqrt(0.5)
    np.testing.assert_allclose(mounting[:, 2], [root, 0, -root], atol=1e-12)  # ahead of the lens
    np.testing.assert_allclose(mounting[:, 0], [0, -1, 0], atol=1e-12)  # right in the image


def test_clipped_pixels_have_the_outermost_ray() -> None:
    ray = LENS.undistort(np.array([0.0, 0.0]), clip=True)
    assert np.hypot(*ray) == pytest.approx(LENS.reach, abs=0.05)
    assert np.isfinite(LENS.undistort(LENS.project(np.append(0.95 * ray, 1.0)))).all()


def test_a_point_is_seen_within_the_image_and_the_reach_only() -> None:
    ahead, behind, aside, folded = [0, 0, 1.0], [0, 0, -1.0], [2.0, 0, 1.0], [30.0, 0, 1.0]
    assert LENS.sees(np.array([ahead, behind, aside, folded])).tolist() == [True] + 3 * [False]
    assert not LENS.sees(np.array(ahead), border=90.0)  # px, more than the rows below have
