"""A tag as a factor: its derivatives, and gtsam's view of it."""

from __future__ import annotations

import math

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import E, X
from hypothesis import given
from hypothesis import strategies as st

from star_apriltag.smoother import HUBER, _by_mounting, tag_factor
from star_apriltag.vision.body_pose import AT_REST, Motion, View, reproject
from star_core import Array, Pose, rotation_from_quaternion, rotation_from_vector
from star_core.world.quaternions import turned
from tests.plugins.localizers.apriltag.conftest import LENS, Circle, sheets, views

MOUNTING = LENS.mounting
STEP = 1e-6
vector = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


def of(body: Pose) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3(body.rotation), body.position)


def a_view() -> tuple[Pose, View]:
    circle = Circle(10)
    for time in np.arange(0, 9, 0.1):
        body = circle.body(float(time))
        if found := views(body, sheets()):
            return body, found[0]
    raise AssertionError("nothing is seen")


BODY, VIEW = a_view()
POINT = View(VIEW.points[:1], VIEW.rays[:1], VIEW.deviation, VIEW.delay[:1])


def projected(
    body: Pose, extra: Array, motion: Motion = AT_REST, view: View = VIEW
) -> tuple[Array, Array, Array]:
    """Return the residual and its derivatives by the body and by the turn of the camera."""
    camera = Pose(MOUNTING.rotation @ extra.T, MOUNTING.position)
    seen, residual, by_pose, by_camera = reproject(body, view, motion, camera)
    return residual, by_pose, _by_mounting(seen, by_camera, extra)


def seen(body: Pose, extra: Array, motion: Motion = AT_REST, view: View = VIEW) -> Array:
    return projected(body, extra, motion, view)[0]


def test_the_true_pose_has_no_residual() -> None:
    assert np.abs(seen(BODY, np.eye(3))).max() < 1e-8


@given(vector, vector, vector, vector, vector, st.floats(-0.02, 0.02))
def test_derivatives_are_those_that_differences_give(
    shift: Array, tilt: Array, extra: Array, velocity: Array, rates: Array, delay: float
) -> None:
    body = Pose(BODY.rotation @ rotation_from_vector(0.2 * tilt), BODY.position + 0.1 * shift)
    mount, motion = rotation_from_vector(0.1 * extra), Motion(velocity, rates)
    view = VIEW._replace(delay=delay * np.array([1.0, 0.5, -0.5, -1.0]))
    _, by_pose, by_mounting = projected(body, mount, motion, view)
    for k, step in enumerate(STEP * np.eye(6)):
        ahead = seen(body.moved(step), mount, motion, view)
        back = seen(body.moved(-step), mount, motion, view)
        assert by_pose[:, k] == pytest.approx((ahead - back) / (2 * STEP), abs=2e-5, rel=1e-5)
    for k, step in enumerate(STEP * np.eye(3)):
        ahead = seen(body, mount @ rotation_from_vector(step), motion, view)
        back = seen(body, mount @ rotation_from_vector(-step), motion, view)
        assert by_mounting[:, k] == pytest.approx((ahead - back) / (2 * STEP), abs=2e-5, rel=1e-5)


@given(vector, vector, vector)
def test_a_point_is_seen_as_the_corner_of_a_tag_is(shift: Array, tilt: Array, rates: Array) -> None:
    body = Pose(BODY.rotation @ rotation_from_vector(0.2 * tilt), BODY.position + 0.1 * shift)
    tag, point = (projected(body, np.eye(3), Motion(shift, rates), view) for view in (VIEW, POINT))
    for of_tag, of_point in zip(tag, point, strict=True):
        assert of_point == pytest.approx(of_tag[:2], abs=1e-12)


def test_a_point_weighs_as_one_point() -> None:
    body = Pose(BODY.rotation, BODY.position + np.array([0.001, 0.0, 0.0]))
    far = float(np.linalg.norm(seen(body, np.eye(3), view=POINT))) / POINT.deviation
    assert far < HUBER
    made = tag_factor(X(1), E(0), POINT, AT_REST, MOUNTING)
    assert made.dim() == 2
    assert made.error(values(body, np.eye(3))) == pytest.approx(far**2 / 2, rel=1e-6)


@given(vector, vector)
def test_the_tangent_is_gtsams_own(shift: Array, tilt: Array) -> None:
    step = 0.05 * np.concatenate([tilt, shift])
    moved = of(BODY).retract(1e-4 * step).matrix()[:3]
    ours = BODY.moved(1e-4 * step)
    assert np.abs(moved - np.column_stack([ours.rotation, ours.position])).max() < 1e-9


def test_a_row_that_is_read_late_is_seen_from_further_on() -> None:
    velocity, rates, delay = np.array([0.3, 0.1, -0.2]), np.array([0.1, -0.2, 0.5]), 1e-3
    later = BODY.moved(delay * np.concatenate([rates, velocity]))
    late = VIEW._replace(delay=np.full(4, delay))
    there = seen(BODY, np.eye(3), Motion(velocity, rates), late)
    assert there == pytest.approx(seen(later, np.eye(3)), abs=1e-6)


def values(body: Pose, extra: Array) -> gtsam.Values:
    held = gtsam.Values()
    held.insert(X(1), of(body))
    held.insert(E(0), gtsam.Rot3(extra))
    return held


@given(vector, vector)
def test_gtsam_finds_the_residual_over_its_deviation(shift: Array, extra: Array) -> None:
    body, mount = (
        Pose(BODY.rotation, BODY.position + 0.05 * shift),
        rotation_from_vector(0.02 * extra),
    )
    made = tag_factor(X(1), E(0), VIEW, AT_REST, MOUNTING)
    assert made.unwhitenedError(values(body, mount)) == pytest.approx(seen(body, mount), abs=1e-12)


@given(st.floats(0.0, 0.3))
def test_its_error_is_hubers_loss_of_the_whole_tag(aside: float) -> None:
    body = Pose(BODY.rotation, BODY.position + np.array([aside, 0.0, 0.0]))
    made = tag_factor(X(1), E(0), VIEW, AT_REST, MOUNTING)
    far = float(np.linalg.norm(seen(body, np.eye(3)))) / VIEW.deviation
    loss = far**2 / 2 if far <= HUBER else HUBER * (far - HUBER / 2)
    assert made.error(values(body, np.eye(3))) == pytest.approx(loss, rel=1e-6, abs=1e-9)


def test_gtsam_linearises_it_by_our_derivatives() -> None:
    body = Pose(BODY.rotation @ rotation_from_quaternion(turned(0.001, -0.001, 0)), BODY.position)
    _, by_pose, by_mounting = projected(body, np.eye(3))
    jacobian, _ = (
        tag_factor(X(1), E(0), VIEW, AT_REST, MOUNTING)
        .linearize(values(body, np.eye(3)))
        .jacobian()
    )
    far = float(np.linalg.norm(seen(body, np.eye(3)))) / VIEW.deviation
    weight = math.sqrt(min(1.0, HUBER / far)) / VIEW.deviation
    assert jacobian == pytest.approx(weight * np.hstack([by_pose, by_mounting]), rel=1e-6, abs=1e-6)


def test_a_tag_behind_the_camera_leaves_everything_finite() -> None:
    behind = Pose(BODY.rotation @ rotation_from_quaternion(turned(0, 0, math.pi)), BODY.position)
    for part in projected(behind, np.eye(3)):
        assert np.isfinite(part).all()
