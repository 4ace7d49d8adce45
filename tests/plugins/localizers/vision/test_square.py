import numpy as np
import pytest

from star_apriltag.vision.tag_poses import corner_std, solve
from star_core import Array
from tests.plugins.localizers.vision.conftest import LENS, hovering, in_map, on_floor, tag_corners

SIZE = 0.168


@pytest.fixture
def pixels() -> Array:
    corners = tag_corners(hovering(), on_floor(1, 0.8, 0.1, yaw=0.4))
    assert corners is not None
    return corners


def test_a_square_is_found_where_it_is(pixels: Array) -> None:
    square = solve(LENS.undistort(pixels), SIZE, LENS)
    tag = (hovering() @ LENS.mounting).inverse() @ in_map(on_floor(1, 0.8, 0.1, yaw=0.4))
    assert square is not None
    (best, misfit), (_, other) = square.solutions
    np.testing.assert_allclose(best.position, tag.position, atol=1e-5)
    np.testing.assert_allclose(best.rotation, tag.rotation, atol=1e-4)
    assert square.distance == pytest.approx(np.linalg.norm(tag.position))
    assert misfit < other


@pytest.mark.parametrize(
    "order", [[3, 2, 1, 0], [0, 2, 1, 3], [0] * 4], ids=["mirrored", "crossed", "one point"]
)
def test_corners_in_a_wrong_order_are_no_square(pixels: Array, order: list[int]) -> None:
    assert solve(LENS.undistort(pixels[order]), SIZE, LENS) is None


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e12])
def test_corners_that_no_lens_shows_are_no_square(pixels: Array, value: float) -> None:
    pixels[2] = value
    assert solve(LENS.undistort(pixels), SIZE, LENS) is None


def test_a_tag_twice_as_large_is_as_sure_at_twice_the_distance() -> None:
    assert corner_std(2.4, 0.336) == pytest.approx(corner_std(1.2, 0.168))
    assert corner_std(1.2, 0.168) > corner_std(0.8, 0.168)
