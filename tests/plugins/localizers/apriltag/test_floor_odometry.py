"""Motion from one image to the next, by the floor."""

from __future__ import annotations

import cmath
import math

import cv2
import numpy as np
import pytest

from star_apriltag.floor_odometry import MAX_INTERVAL, FloorOdometry, MeasuredMotion
from star_apriltag.odometry_track import OdometryTrack
from star_core import Array, Camera, Image, Odometry
from star_core.toolkit import CameraModel, rotation_from_vector
from tests.plugins.localizers.vision.conftest import turned_model

CAMERA = Camera(readout=0.0)
LENS = CameraModel(CAMERA)
HEIGHT = 0.8
TEXEL = 0.005  # m
STAINS = cv2.GaussianBlur(np.random.default_rng(5).normal(0, 60, (1024, 1024)), (0, 0), 1.5)
FROM, TO = 1.0, 1.1  # s
NOISE = 4.0


def picture(
    place: complex = 0j,
    yaw: float = 0.0,
    *,
    height: float = HEIGHT,
    stains: float = 1.0,
    key: int = 0,
    lens: CameraModel = LENS,
) -> Image:
    """What a camera of a level body sees of a stained floor."""
    rays = np.dstack([lens.rays, np.ones(lens.shape)]) @ lens.mounting.rotation.T
    eye = lens.mounting.position + np.array([0.0, 0.0, height])
    down = np.where(rays[..., 2] < -0.1, -rays[..., 2], np.nan)
    beside = (eye[:2] + rays[..., :2] * (eye[2] / down)[..., None]) @ np.array([1.0, 1j])
    texel = (beside * cmath.rect(1.0, yaw) + place) / TEXEL + complex(512, 512)
    gray = cv2.remap(
        115 + stains * STAINS,
        np.nan_to_num(texel.real).astype(np.float32),
        np.nan_to_num(texel.imag).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REFLECT,
    )
    noise = np.random.default_rng(key).normal(0, NOISE, gray.shape)
    image: Image = np.clip(np.rint(gray + noise), 0, 255).astype(np.uint8)
    return image


def track(
    velocity: complex = 0j, yaw_rate: float = 0.0, *, height: float = HEIGHT
) -> OdometryTrack:
    """Two seconds of odometry."""
    time = np.arange(1, 201) / 100
    zero = np.zeros(len(time))
    odometry = OdometryTrack()
    velocities = np.column_stack([zero + velocity.real, zero + velocity.imag, zero])
    odometry.add(
        Odometry(zero.astype(int), time, velocities, zero + yaw_rate, zero, zero, zero + height),
        np.arange(len(time)),
    )
    return odometry


def measure(
    floor: FloorOdometry,
    image: Image,
    time: float,
    odometry: OdometryTrack,
    *,
    ground: float = 0.0,
    yaw_bias: float = 0.0,
    needed: bool = True,
) -> MeasuredMotion | None:
    """The motion by a camera whose mounting is exact."""
    return floor.measure(
        image,
        time,
        odometry,
        ground=ground,
        yaw_bias=yaw_bias,
        camera_turn=np.eye(3),
        needed=needed,
    )


def shift(
    first: Image,
    second: Image,
    odometry: OdometryTrack,
    *,
    yaw_bias: float = 0.0,
    lens: CameraModel = LENS,
) -> complex | None:
    floor = FloorOdometry(lens)
    assert measure(floor, first, FROM, odometry, ground=0.0, yaw_bias=yaw_bias) is None
    motion = measure(floor, second, TO, odometry, ground=0.0, yaw_bias=yaw_bias)
    if motion is None:
        return None
    assert (motion.begin, motion.end) == (FROM, TO)
    return motion.shift


@pytest.mark.parametrize("way", [0.03 + 0j, -0.02 + 0.02j, 0.04j])
def test_the_way_is_found_to_a_millimetre_though_odometry_errs(way: complex) -> None:
    odometry = track(10 * way + (0.05 - 0.04j))
    motion = shift(picture(key=1), picture(way, key=2), odometry)
    assert motion == pytest.approx(way, abs=0.001)


def test_a_turn_is_the_gyros_less_its_bias() -> None:
    turned, bias = 0.06, 0.02
    odometry = track(0.3 + 0j, turned / (TO - FROM) + bias)
    motion = shift(picture(key=1), picture(0.03 + 0j, turned, key=2), odometry, yaw_bias=bias)
    assert motion == pytest.approx(0.03, abs=0.001)


def test_the_way_is_one_in_the_body_of_the_first_image() -> None:
    yaw = 2.0
    first, second = picture(0.2j, yaw, key=1), picture(0.2j + cmath.rect(0.03, yaw), yaw, key=2)
    assert shift(first, second, track(0.3 + 0j)) == pytest.approx(0.03, abs=0.001)


@pytest.mark.parametrize(
    ("way", "velocity", "options"),
    [
        (0j, 0.3, {"stains": 0.0}),
        (0j, 1.0, {}),
        (1.5 + 1j, 0.0, {}),
        (0.01 + 0j, 0.1, {"height": 0.1}),
    ],
    ids=["no texture", "moves along", "another floor", "near the floor"],
)
def test_what_shows_no_motion_of_the_floor_gives_none(
    way: complex, velocity: float, options: dict[str, float]
) -> None:
    first, second = picture(key=1, **options), picture(way, key=2, **options)  # type: ignore[arg-type]
    odometry = track(complex(velocity), height=options.get("height", HEIGHT))
    assert shift(first, second, odometry) is None


def test_objects_on_the_floor_do_not_disturb_the_shift() -> None:
    first, second = picture(key=1), picture(0.03 + 0j, key=2)
    first[:, 200:260] = second[:, 200:260] = picture(1j, key=3)[:, 200:260]
    assert shift(first, second, track(0.3 + 0j)) == pytest.approx(0.03, abs=0.002)


@pytest.mark.parametrize(
    "times", [(0.5, 0.6 + MAX_INTERVAL), (1.95, 2.05)], ids=["far apart", "newer than odometry"]
)
def test_images_at_other_times_give_no_motion(times: tuple[float, float]) -> None:
    floor, odometry = FloorOdometry(LENS), track()
    motions = [measure(floor, picture(key=k), time, odometry) for k, time in enumerate(times)]
    assert motions == [None, None]


def test_images_may_be_lost_in_between() -> None:
    floor, odometry = FloorOdometry(LENS), track(0.36 + 0.03j, 0.5)
    measure(floor, picture(key=1), 1.0, odometry)
    # On an arc of 0.3 m/s and 0.5 rad/s, after 0.4 s.
    way = 0.3 / 0.5 * complex(math.sin(0.2), 1 - math.cos(0.2))
    motion = measure(floor, picture(way, 0.2, key=2), 1.4, odometry)
    assert motion is not None
    assert motion.shift == pytest.approx(way, abs=0.002)


def test_after_a_gap_the_next_two_images_give_the_motion() -> None:
    floor, odometry = FloorOdometry(LENS), track(0.3 + 0j)
    measure(floor, picture(key=1), 0.1, odometry)
    measure(floor, picture(key=2), 1.5, odometry)
    motion = measure(floor, picture(0.03 + 0j, key=3), 1.6, odometry)
    assert motion is not None
    assert motion.shift == pytest.approx(0.03, abs=0.001)


def test_an_error_of_the_mounting_is_a_constant_factor() -> None:
    """Which is what calibration can learn."""
    ways: Array = np.array([0.01, 0.02, 0.04])
    odometry = [track(10 * way + 0j, height=0.82) for way in ways.tolist()]
    motions = [
        shift(picture(key=1), picture(way, key=2), leg)
        for way, leg in zip(ways.tolist(), odometry, strict=True)
    ]
    factors = np.array(motions, complex) / ways
    assert np.abs(factors - 0.82 / HEIGHT).max() < 0.05
    assert math.isclose(factors[-1].real, 0.82 / HEIGHT, abs_tol=0.01)


def test_a_camera_that_is_known_to_be_turned_is_taken_as_it_is() -> None:
    # The belief is wrong by this ...
    error = rotation_from_vector(np.array([0.0, 0.0, math.radians(3.0)]))
    lens = turned_model(error, Camera(readout=0.0))
    odometry, ways = track(0.3 + 0j), []
    for camera_turn in (np.eye(3), error):  # ... which the filter does not know, or does
        floor = FloorOdometry(lens)
        for image, time in ((picture(key=1), FROM), (picture(0.03 + 0j, key=2), TO)):
            motion = floor.measure(
                image, time, odometry, ground=0.0, yaw_bias=0.0, camera_turn=camera_turn
            )
        assert motion is not None
        ways.append(abs(motion.shift - 0.03))
    assert ways[1] == pytest.approx(0, abs=0.0005)
    assert ways[0] > 2 * ways[1]


def test_a_turn_that_odometry_misses_does_not_hide_the_way() -> None:
    """Times of images are known to some 0.02 s only, and drones turn by 50 °/s."""
    first, second = picture(key=1), picture(0.03 + 0j, 0.02, key=2)
    assert shift(first, second, track(0.3 + 0j)) == pytest.approx(0.03, abs=0.0015)


def test_points_near_the_horizon_are_as_good_as_others() -> None:
    """With this camera, windows around the farthest points contain what is no floor."""
    way, odometry = 0.03, track(0.3 + 0j)
    lens = turned_model(rotation_from_vector(np.array([math.radians(-4.0), 0.0, 0.0])), CAMERA)
    for key in range(4):
        first, second = picture(key=key, lens=lens), picture(way + 0j, key=8 + key, lens=lens)
        assert shift(first, second, odometry, lens=lens) == pytest.approx(way, abs=0.0005)


def test_a_pattern_of_the_sensor_is_noticed_within_some_images() -> None:
    floor, odometry = FloorOdometry(LENS), track(0.28 + 0j)
    motions = [measure(floor, picture(key=k), 0.1 * k, odometry) for k in range(1, 16)]
    assert all(motion is None for motion in motions[4:])


def test_an_image_that_is_only_kept_serves_the_next_one() -> None:
    floor, odometry = FloorOdometry(LENS), track(0.3 + 0j)
    for k in range(3):
        kept = picture(0.03 * k + 0j, key=k)
        assert measure(floor, kept, FROM + 0.1 * k, odometry, needed=False) is None
    motion = measure(floor, picture(0.09 + 0j, key=4), FROM + 0.3, odometry)
    assert motion is not None
    assert motion.shift == pytest.approx(0.03, abs=0.001)


def test_an_image_of_another_size_is_an_error() -> None:
    with pytest.raises(ValueError, match="expected"):
        measure(FloorOdometry(LENS), np.zeros((10, 10), np.uint8), 1.0, track())
