"""What ``flow`` sees of targets: tags that cameras found on board."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import star_flow
from star_core import (
    Agent,
    Array,
    Camera,
    Detections,
    Estimate,
    Frames,
    Localizer,
    Scene,
    Tag,
    Telemetry,
)
from star_core.testing import scene
from star_core.toolkit import fill_defaults, square_corners
from star_flow.drift import heading_variance
from star_flow.target_sightings import square_fix
from tests.plugins.localizers.conftest import report

SIZE = 0.168
CAMERA = Camera()
LEVEL = (0.0, 0.0, 0.0, 1.0)
FLAT = Tag(100, SIZE, (2.2, 2.3, 0.0), LEVEL, "red")
TURNED = Rotation.from_euler("ZYX", [0.5, 0.0, math.pi / 2])  # upright
HUNG = Tag(
    101, SIZE, (2.9, 2.2, 0.5), tuple((Rotation.from_euler("Z", -2.0) * TURNED).as_quat()), "green"
)
START, YAW = (1.2, 2.0, 0.0), 0.3


def room(*targets: Tag, camera: Camera | None = CAMERA) -> Scene:
    plain = scene(1)
    world = replace(
        plain.world,
        targets=targets or (FLAT, HUNG),
        landmarks=(Tag(1, SIZE, (1.9, 2.0, 0.0), LEVEL, "a"),),
    )
    return replace(plain, agents=(Agent("cf1", START, YAW, None, camera),), world=world)


def corners(tag: Tag, position: Any, body: Rotation, camera: Camera = CAMERA) -> Array:
    """(4, 2) px: where OpenCV shows a tag's corners to an agent at a place in the map."""
    points = Rotation.from_quat(tag.rotation).apply(square_corners(tag.size)) + tag.position
    eye = body * Rotation.from_quat(camera.rotation)
    camera_points = eye.inv().apply(points - (np.array(position) + body.apply(camera.position)))
    assert (camera_points[:, 2] > 0).all()
    matrix = np.array(
        [
            [camera.matrix[0], 0, camera.matrix[2]],
            [0, camera.matrix[1], camera.matrix[3]],
            [0, 0, 1],
        ]
    )
    pixels, _ = cv2.projectPoints(
        camera_points, np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion)
    )
    return np.asarray(pixels, np.float64).reshape(4, 2)


def detections(*sightings: tuple[int, Array], taken: float, arrived: float) -> Detections:
    k = len(sightings)
    return Detections(
        agent=np.zeros(k, np.int64),
        tag=np.array([tag for tag, _ in sightings]),
        corners=np.array([pixels for _, pixels in sightings]),
        taken=np.full(k, taken),
        arrived=np.full(k, arrived),
    )


def heard(time: float, position: Any, body: Rotation, **more: Any) -> Telemetry:
    """The report of an agent at a place in its own odometry frame."""
    return report([position], time=time, attitude=body.as_quat()[None], **more)


def flow(of: Scene, **options: float) -> Localizer:
    (offer,) = star_flow.star_localizers()
    return offer.make(of, **fill_defaults(options, offer.options))


def along(time: float) -> tuple[Array, Rotation]:
    """Where an agent that flies and turns is after a time, in its odometry frame."""
    body = Rotation.from_euler("ZYX", [0.4 * time, 0.05, -0.03])
    return np.array([0.2 * time, 0.1 * time, 0.8]), body


def in_map(position: Array, body: Rotation) -> tuple[Array, Rotation]:
    turned = Rotation.from_euler("Z", YAW)
    return turned.apply(position) + START, turned * body


def flown(
    made: Localizer, *tags: Tag, taken: float = 0.325, late: float = 0.15, stamped: bool = True
) -> Estimate:
    """The estimate of the tick in which what was seen at `taken`, on the way, arrives."""
    time = 0.0
    while time < taken + late:
        made.locate(heard(time, *along(time)))
        time += 0.05
    tag_corners = [(tag.id, corners(tag, *in_map(*along(taken)))) for tag in tags]
    batch = detections(*tag_corners, taken=taken if stamped else math.nan, arrived=taken + late)
    return made.locate(heard(time, *along(time), detections=batch))


@given(
    st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(0.5, 1.5)),
    st.floats(-3.1, 3.1),
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
)
def test_a_square_lies_at_its_exact_corners(
    centre: tuple[float, float, float], spin: float, roll: float, pitch: float
) -> None:
    """Its face is towards the camera, which looks straight down."""
    facing = Rotation.from_euler("xyz", [math.pi + roll, pitch, 0]) * Rotation.from_euler("z", spin)
    points = facing.apply(square_corners(SIZE)) + centre
    if facing.apply([0, 0, 1]) @ np.array(centre) > -0.25:  # its edge or its back
        return
    fix = square_fix(points[:, :2] / points[:, 2:], SIZE, np.array([0.0, 0.0, -1.0]), 1e-3)
    assert fix is not None
    assert fix.pose.position == pytest.approx(centre, rel=0.01, abs=0.005)


BEHIND = square_corners(SIZE)[:, :2]  # at 1 m; its z axis points away from the camera


@pytest.mark.parametrize(
    "rays",
    [[[0, 0], [0.2, 0], [0.02, 0.1], [0, 0.2]], np.zeros((4, 2)), BEHIND],
    ids=["no square", "one point", "its back"],
)
def test_what_is_no_square_is_not_seen(rays: ArrayLike) -> None:
    assert square_fix(np.array(rays), SIZE, np.array([0, 0, -1.0]), 1e-3) is None


@given(arrays(np.float64, (4, 2), elements=st.floats(-3, 3)))
def test_any_corners_give_a_position_in_front_or_none(rays: Array) -> None:
    fix = square_fix(rays, SIZE, np.array([0.0, -math.sqrt(0.5), -math.sqrt(0.5)]), 1e-3)
    if fix is not None:
        assert fix.pose.position[2] > 0
        assert np.isfinite(fix.covariance).all()


def test_the_covariance_of_a_square_is_that_of_its_places() -> None:
    facing = Rotation.from_euler("xyz", [math.pi - 0.7, 0.1, 0.4])
    points = facing.apply(square_corners(SIZE)) + np.array([0.1, -0.1, 1.0])
    rng, deviation = np.random.default_rng(0), 1.5e-3
    exact = points[:, :2] / points[:, 2:]
    up = facing.apply([0.0, 0, 1])
    fixes = [
        square_fix(exact + rng.normal(0, deviation, (4, 2)), SIZE, up, deviation)
        for _ in range(300)
    ]
    places = np.array([fix.pose.position for fix in fixes if fix is not None])
    assert len(places) > 290
    first = square_fix(exact, SIZE, up, deviation)
    assert first is not None
    measured = np.sqrt(np.diag(np.cov(places.T)))
    assert measured == pytest.approx(np.sqrt(np.diag(first.covariance)), rel=0.25)


@pytest.mark.parametrize("tag", [FLAT, HUNG], ids=["on the floor", "on a wall"])
def test_a_target_is_seen_where_it_is_from_where_the_agent_was(tag: Tag) -> None:
    sightings = flown(flow(room()), tag).sightings
    assert sightings.agent.tolist() == [0]
    assert sightings.tag.tolist() == [tag.id]
    assert sightings.time == pytest.approx([0.325])
    assert sightings.position[0] == pytest.approx(tag.position, abs=2e-3)
    axis = Rotation.from_quat(tag.rotation).apply([1, 0, 0])
    assert sightings.yaw == pytest.approx([math.atan2(axis[1], axis[0])], abs=0.02)


def test_tags_without_a_timestamp_have_the_latency() -> None:
    sightings = flown(flow(room(), latency=0.3), FLAT, late=0.3, stamped=False).sightings
    assert sightings.time == pytest.approx([0.325])
    assert sightings.position[0] == pytest.approx(FLAT.position, abs=2e-3)
    wrong = flown(flow(room(), latency=0.0), FLAT, late=0.3, stamped=False).sightings
    assert np.linalg.norm(wrong.position[0] - FLAT.position) > 0.05


def test_a_report_that_is_late_counts_for_when_it_was_made() -> None:
    made = flow(room())
    for tick in range(12):
        time = 0.05 * tick
        made.locate(heard(time + 0.1, *along(time), age=np.full(1, 0.1)))
    batch = detections((100, corners(FLAT, *in_map(*along(0.3)))), taken=0.3, arrived=0.7)
    sightings = made.locate(
        heard(0.7, *along(0.6), age=np.full(1, 0.1), detections=batch)
    ).sightings
    assert sightings.position[0] == pytest.approx(FLAT.position, abs=2e-3)


def test_sighting_covariance_includes_agent_and_heading_drift() -> None:
    estimate = flown(flow(room()), FLAT)
    at, _ = in_map(*along(0.325))
    x, y, _ = FLAT.position - at
    aside = np.array([-y, x, 0.0])
    least = 0.9 * estimate.covariance[0] + heading_variance(0.325) * np.outer(aside, aside)
    assert (np.linalg.eigvalsh(estimate.sightings.covariance[0] - least) > 0).all()


def test_a_heading_is_less_sure_the_longer_ago_it_was_known() -> None:
    assert heading_variance(0.0) == pytest.approx(math.radians(1.0) ** 2)
    assert math.sqrt(heading_variance(600.0)) == pytest.approx(math.radians(120), rel=0.01)


@pytest.mark.parametrize(
    ("tag", "taken", "scale"),
    [(1, 0.0, 1.0), (77, 0.0, 1.0), (100, -1.0, 1.0), (100, 5.0, 1.0), (100, 0.0, math.nan)],
    ids=["landmark", "unknown number", "before the flight", "in the future", "no corners"],
)
def test_what_is_no_target_seen_from_a_known_pose_is_ignored(
    tag: int, taken: float, scale: float
) -> None:
    made = flow(room())
    made.locate(heard(0.0, *along(0.0)))
    pixels = scale * corners(FLAT, *in_map(*along(0.0)))
    batch = detections((tag, pixels), taken=taken, arrived=0.1)
    assert not len(made.locate(heard(0.1, *along(0.1), detections=batch)).sightings.tag)


def test_an_agent_that_reported_nothing_sees_nothing() -> None:
    made = flow(room())
    gone = replace(heard(0.0, *along(0.0)), attitude=np.full((1, 4), np.nan))
    made.locate(gone)
    batch = detections((100, corners(FLAT, *in_map(*along(0.0)))), taken=0.0, arrived=0.1)
    assert not len(made.locate(replace(gone, time=0.1, detections=batch)).sightings.tag)


def test_agents_first_heard_in_flight_sight_targets_at_once() -> None:
    made = flow(room())
    made.locate(heard(0.0, *along(0.0), age=np.full(1, np.nan)))
    made.locate(heard(0.05, *along(0.05)))
    batch = detections((100, corners(FLAT, *in_map(*along(0.05)))), taken=0.05, arrived=0.1)
    sightings = made.locate(heard(0.1, *along(0.1), detections=batch)).sightings
    assert sightings.position[0] == pytest.approx(FLAT.position, abs=2e-3)


def test_a_warning_that_images_are_not_processed_is_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    made = flow(room())
    image = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    frames = Frames(np.array([0]), np.array([0.0]), np.array([0.1]), (image,))
    with caplog.at_level(logging.WARNING):
        for time in (0.1, 0.2):
            made.locate(heard(time, *along(time), frames=frames))
    assert [record.message.partition(";")[0] for record in caplog.records] == [
        "flow: images are not processed, so no target is seen"
    ]
