"""Where points of the map come to lie in the image."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from star_core import Array, Camera
from star_sim.camera_sim.camera_pose import Exposure, Shot, mounting, optics, poses, rays, row_time
from star_sim.camera_sim.projection import project, touch
from tests.plugins.transports.star_sim.camera_sim.conftest import take

CAMERA = Camera()
LENS, MOUNT = optics(CAMERA), mounting(CAMERA)
SPEEDS = st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2))


def pixels(points: ArrayLike, shot: Shot) -> Array:
    return project(np.atleast_2d(np.asarray(points, float)), shot.packed(), MOUNT, LENS)


def test_the_middle_ray_hits_the_floor_at_the_geometric_point() -> None:
    # A point on the optical axis: 0.8 m + 15 mm over the floor, 45° down, 25 mm ahead.
    axis = [0.025 + 0.815, 0.0, 0.0]
    assert pixels(axis, take())[0] == pytest.approx(CAMERA.matrix[2:], abs=1e-6)


def test_image_right_and_down_are_floor_right_and_near() -> None:
    ahead, right, near = pixels([[1.0, 0, 0], [1.0, -0.2, 0], [0.8, 0, 0]], take())
    assert right[0] > ahead[0] + 10
    assert near[1] > ahead[1] + 10


@given(SPEEDS, SPEEDS)
def test_a_point_is_seen_from_where_the_camera_is_at_its_row(
    velocity: tuple[float, ...], rates: tuple[float, ...]
) -> None:
    points = np.array([[0.5, 0.0, 0.0], [0.9, 0.3, 0.1], [1.5, -0.4, 0.0]])
    shot = take(velocity=velocity, rates=rates)
    for point, pixel in zip(points, pixels(points, shot), strict=True):
        late = row_time(LENS, pixel[1])
        turn = Rotation.from_quat(shot.attitude) * Rotation.from_rotvec(late * shot.rates)
        frozen = take(shot.position + late * shot.velocity)._replace(attitude=turn.as_quat())
        assert pixels(point, frozen)[0] == pytest.approx(pixel, abs=1e-6)


def test_what_is_behind_or_far_outside_is_not_seen() -> None:
    assert np.isnan(pixels([[-1.0, 0, 0], [0.2, 5.0, 0], [0.0, 0.0, 2.5]], take())).all()


@example(seed=4927)  # an edge of which one end is much nearer
@given(st.integers(0, 10_000))
def test_the_region_that_is_drawn_holds_every_point_of_a_sheet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shot = take(rng.uniform([-1, -1, 0.1], [1, 1, 1.5]), tuple(rng.normal(0, 0.4, 3)))
    origin, right, left = rng.uniform([-2, -2, 0], [2, 2, 1.0], (3, 3))
    corners = np.array([origin, right, right + left - origin, left])
    x, y = rays(CAMERA)
    region = np.array([324, 244, 0, 0])
    track = poses(shot.packed(), MOUNT, LENS, 1)
    field = (x.min(), y.min(), x.max(), y.max())
    touch(corners, Exposure(rays(CAMERA), track, LENS, field), region)
    a, b = rng.random((2, 500, 1))
    points = pixels(origin + a * (right - origin) + b * (left - origin), shot)
    inside = (points > -0.5) & (points < [323.5, 243.5])
    points = points[inside.all(axis=1)]
    assert (points > region[:2] - 0.5).all()
    assert (points < region[2:] - 0.5).all()
