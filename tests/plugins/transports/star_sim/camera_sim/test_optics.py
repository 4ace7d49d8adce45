"""Whether the lens is OpenCV's, both ways."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from star_core import Array, Camera
from star_core.toolkit import CameraModel
from star_sim.camera_sim.camera_pose import optics, rays

LENSES = st.builds(
    lambda fx, fy, cx, cy, distortion: Camera(
        width=64, height=48, matrix=(fx, fy, cx, cy), distortion=distortion
    ),
    st.floats(30, 80),
    st.floats(30, 80),
    st.floats(20, 44),
    st.floats(15, 33),
    st.tuples(
        st.floats(-0.2, 0.3),
        st.floats(-0.02, 0.05),
        st.floats(-0.002, 0.002),
        st.floats(-0.002, 0.002),
        st.floats(-0.01, 0.01),
    ),
)


def by_opencv(camera: Camera, directions: Array) -> Array:
    """Pixels of (2, H, W) directions, (H, W, 2)."""
    fx, fy, cx, cy = camera.matrix
    points = np.concatenate([directions, np.ones((1, *directions.shape[1:]))])
    pixels, _ = cv2.projectPoints(
        points.reshape(3, -1).T,
        np.zeros(3),
        np.zeros(3),
        np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        np.array(camera.distortion),
    )
    return np.asarray(pixels, np.float64).reshape(*directions.shape[1:], 2)


@example(  # tangential distortion: clipped pixels have rays shorter than the reach
    Camera(
        width=64,
        height=48,
        matrix=(30.0, 30.0, 20.0, 15.0),
        distortion=(-0.125, 0.0, 0.0, 0.001953125, 0.0),
    )
)
@example(  # likewise: pixels within the reach have rays beyond it
    Camera(
        width=64,
        height=48,
        matrix=(30.0, 30.0, 33.0, 15.0),
        distortion=(0.0, 0.0, 0.0, 0.001953125, -0.0078125),
    )
)
@given(LENSES)
def test_opencv_sees_the_ray_of_each_pixel_at_that_pixel(camera: Camera) -> None:
    directions = rays(camera)
    trusted = np.isfinite(CameraModel(camera).rays[..., 0])  # the others are clipped
    v, u = np.indices(trusted.shape)
    pixels = by_opencv(camera, directions)
    assert trusted[24, 32]
    assert pixels[trusted] == pytest.approx(np.stack([u, v], axis=-1)[trusted], abs=1e-6)


def test_folding_lens_models_are_limited_at_their_reach() -> None:
    lens = optics(Camera())  # the calibrated one does, at the upper left corner
    directions = np.hypot(*rays(Camera()))
    beyond = directions > lens.reach - 1e-6
    assert beyond[0, 0]
    assert beyond.mean() < 0.01
    assert np.isfinite(directions).all()
