import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from star_apriltag.vision.body_pose import AT_REST, Motion, View, refine
from star_core import Array, Pose, Tag
from star_core.toolkit import square_corners
from tests.plugins.localizers.vision.conftest import LENS, hovering, in_map, on_floor

LEVEL = hovering()
TAGS = [on_floor(1, 0.7, -0.105, yaw=0.3), on_floor(2, 0.7, 0.105, yaw=0.3)]


def view(
    body: Pose, tag: Tag, deviation: float, delay: Array | None = None, motion: Motion = AT_REST
) -> View:
    """Returns what a tag looks like, without noise."""
    corners = in_map(tag).apply(square_corners(tag.size))
    late = np.zeros(4) if delay is None else delay
    moving = body.inverse().apply(corners)
    moving = moving + late[:, None] * (np.cross(moving, motion.rates) - motion.velocity)
    camera = LENS.mounting.inverse().apply(moving)
    return View(corners, camera[:, :2] / camera[:, 2:], deviation, late)


def off(pose: Pose, true: Pose) -> Array:
    """Returns the step from what was found to the truth, (6,)."""
    turn = Rotation.from_matrix(pose.rotation.T @ true.rotation).as_rotvec()
    return np.concatenate([turn, pose.rotation.T @ (true.position - pose.position)])


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
def test_the_pose_is_found_from_a_guess_that_is_off(shares: list[float]) -> None:
    body = hovering(yaw=0.1)
    guess = body.moved(np.array(shares) * [0.2, 0.2, 0.4, 0.2, 0.2, 0.2])
    fix = refine(guess, [view(body, tag, 0.002) for tag in TAGS], LENS.mounting)
    assert fix is not None
    np.testing.assert_allclose(off(fix.pose, body), 0, atol=1e-6)
    assert fix.misfit < 0.05


@pytest.mark.parametrize("tags", [TAGS, TAGS[:1]])
def test_errors_agree_with_the_covariance(tags: list[Tag]) -> None:
    rng = np.random.default_rng(0)
    body = hovering(yaw=0.1)
    clean = [view(body, tag, 0.0015) for tag in tags]
    squares = []
    for _ in range(200):
        views = [v._replace(rays=v.rays + rng.normal(0, v.deviation, (4, 2))) for v in clean]
        up = LEVEL.rotation[2] + math.radians(2.0) * rng.normal(0, [1, 1, 0])
        height = np.array([0.0, 0.0, 0.8 + rng.normal(0, 0.02)])
        level = Pose(np.vstack([np.zeros((2, 3)), up]), height)
        fix = refine(body, views, LENS.mounting, level)
        assert fix is not None
        error = off(fix.pose, body)
        squares.append(error @ np.linalg.solve(fix.covariance, error))
    # The mean of 200 values of chi² with 6 degrees of freedom has a deviation of 0.25.
    assert np.mean(squares) == pytest.approx(6, abs=1.2)


def test_the_on_board_tilt_and_height_make_a_far_tag_surer() -> None:
    body = hovering()
    views = [view(body, on_floor(1, 1.2, 0.0), 0.003)]
    alone, held = (refine(body, views, LENS.mounting, level) for level in (None, LEVEL))
    assert alone is not None
    assert held is not None
    assert (np.diag(held.covariance) < np.diag(alone.covariance)).all()
    assert held.covariance[1, 1] < 0.5 * alone.covariance[1, 1]  # the variance of pitch


def test_rolling_shutter_of_a_moving_body_is_modelled() -> None:
    body = hovering()
    motion = Motion(np.array([0.5, 0.1, 0.0]), np.array([0.0, 0.0, 0.8]))
    delay = np.array([0.012, 0.01, 0.005, 0.007])
    views = [view(body, tag, 0.002, delay, motion) for tag in TAGS]
    aware = refine(body, views, LENS.mounting, motion=motion)
    unaware = refine(body, views, LENS.mounting)
    assert aware is not None
    assert unaware is not None
    assert np.abs(off(aware.pose, body)).max() < 1e-5
    assert np.abs(off(unaware.pose, body)).max() > 3e-3


def test_single_points_locate_a_body_of_known_tilt_and_height() -> None:
    body = hovering(yaw=0.1)
    wholes = [view(body, on_floor(1, 0.9, y), 0.002) for y in (-0.4, 0.1, 0.5)]
    points = [View(v.points[:1], v.rays[:1], v.deviation, v.delay[:1]) for v in wholes]
    guess = body.moved(np.array([0.0, 0.0, 0.2, 0.1, -0.1, 0.0]))
    fix = refine(guess, points, LENS.mounting, LEVEL)
    assert fix is not None
    np.testing.assert_allclose(off(fix.pose, body), 0, atol=1e-6)


def test_a_point_and_a_tag_are_more_accurate_than_the_tag_alone() -> None:
    body = hovering()
    tag, far = (view(body, on_floor(1, x, 0.0), 0.002) for x in (0.7, 1.9))
    point = View(far.points[:1], far.rays[:1], far.deviation, far.delay[:1])
    alone, both = (refine(body, views, LENS.mounting, LEVEL) for views in ([tag], [tag, point]))
    assert alone is not None
    assert both is not None
    assert both.covariance[2, 2] < 0.5 * alone.covariance[2, 2]  # the variance of yaw
    assert np.linalg.eigvalsh(alone.covariance - both.covariance).min() > -1e-12


def test_no_pose_is_found_for_tags_behind_the_camera() -> None:
    body = hovering()
    behind = Pose(body.rotation, body.position + np.array([5.0, 0, 0]))
    assert refine(behind, [view(body, TAGS[0], 0.002)], LENS.mounting, LEVEL) is None


def test_no_pose_is_found_for_corners_that_are_no_numbers() -> None:
    broken = view(hovering(), TAGS[0], 0.002)._replace(rays=np.full((4, 2), np.nan))
    assert refine(hovering(), [broken], LENS.mounting, LEVEL) is None
