import numpy as np
import pytest

from star_apriltag.vision.tag_poses import corner_std, solve
from star_core import Array
from star_core.toolkit import CameraModel
from tests.plugins.localizers.vision.conftest import hovering, in_map, on_floor, seen

SIZE = 0.168


@pytest.fixture
def pixels(lens: CameraModel) -> Array:
    corners = seen(lens, hovering(), on_floor(1, 0.8, 0.1, yaw=0.4))
    assert corners is not None
    return corners


def test_a_square_is_found_where_it_is(lens: CameraModel, pixels: Array) -> None:
    square = solve(lens.undistort(pixels), SIZE, lens)
    tag = (hovering() @ lens.mounting).inverse() @ in_map(on_floor(1, 0.8, 0.1, yaw=0.4))
    assert square is not None
    (best, misfit), (_, other) = square.solutions
    np.testing.assert_allclose(best.position, tag.position, atol=1e-5)
    np.testing.assert_allclose(best.rotation, tag.rotation, atol=1e-4)
    assert square.distance == pytest.approx(np.linalg.norm(tag.position))
    assert misfit < other


def test_a_square_seen_in_a_mirror_is_none(lens: CameraModel, pixels: Array) -> None:
    assert solve(lens.undistort(pixels[::-1]), SIZE, lens) is None


def test_corners_that_cross_over_are_no_square(lens: CameraModel, pixels: Array) -> None:
    crossed = pixels[[0, 2, 1, 3]]
    assert solve(lens.undistort(crossed), SIZE, lens) is None


def test_corners_in_one_point_are_no_square(lens: CameraModel) -> None:
    point = np.full((4, 2), 100.0)
    assert solve(lens.undistort(point), SIZE, lens) is None


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e12])
def test_corners_that_no_lens_shows_are_no_square(
    lens: CameraModel, pixels: Array, value: float
) -> None:
    broken = pixels.copy()
    broken[2] = value
    assert solve(lens.undistort(broken), SIZE, lens) is None


def test_a_tag_twice_as_large_is_as_sure_at_twice_the_distance() -> None:
    assert corner_std(2.4, 0.336) == pytest.approx(corner_std(1.2, 0.168))
    assert corner_std(1.2, 0.168) > corner_std(0.8, 0.168)
