"""When the agents' cameras take images, when those arrive, and what the options do to them."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest

import star_sim
from star_core import Agent, Array, Camera, Command, Order, Rows, Scene, Tag
from star_core.testing import scene
from star_core.toolkit import fill_defaults, gray_from_mosaic
from star_core.world.quaternions import turned
from star_sim.airframe import NEVER, STEP
from star_sim.camera_sim.camera_pose import Shot
from star_sim.camera_sim.cameras import Cameras
from star_sim.camera_sim.geometric import OnboardDetector
from star_sim.camera_sim.options import camera_options
from star_sim.camera_sim.sensor import COLOR_RESPONSE
from star_sim.drone import Drones, standing

AHEAD = 0.8  # m: what a camera that looks down at 45° sees from that height
TAGS = (
    Tag(0, 0.168, (AHEAD, 0.0, 0.0), turned(0, 0, 0), "floor"),
    Tag(1, 0.168, (AHEAD, 0.25, 0.0), turned(0, 0, 0.5), "rug"),
)
TARGET = Tag(9, 0.168, (AHEAD, -0.25, 0.0), turned(0, 0, 1.0), "survivor")
EXACT: dict[str, Any] = {
    "mode": "geometric",
    "latency_std": 0.0,
    "corner_noise_std": 0.0,
    "survey_std": 0.0,
    "survey_yaw_std_deg": 0.0,
    "mounting_std_deg": 0.0,
    "mounting_position_std": 0.0,
}


class Seen(NamedTuple):
    """What arrived from one or more cameras, as a long table."""

    agent: Rows
    tag: Rows
    taken: Array
    arrived: Array
    corners: Array

    @property
    def images(self) -> list[float]:
        """When each image of the first agent was taken, s."""
        return sorted(set(self.taken[self.agent == 0].tolist()))


def room(*cameras: Camera | None, tags: tuple[Tag, ...] = TAGS, seed: int = 0) -> Scene:
    """Agents in one place, each with its camera."""
    made = scene(len(cameras), seed=seed)
    return dataclasses.replace(
        made,
        agents=tuple(
            Agent(f"cf{k + 1}", (0.0, 0.0, 0.0), camera=camera) for k, camera in enumerate(cameras)
        ),
        world=dataclasses.replace(made.world, landmarks=tags, targets=(TARGET,)),
    )


def hovering(n: int) -> Drones:
    return standing(np.tile([0.0, 0.0, 0.8], (n, 1)), np.zeros(n), 1.0)


def watched(where: Scene, seconds: float, *, tick: float = 0.05, **options: Any) -> Seen:
    """What the cameras of agents that hover send in some time."""
    cameras = Cameras(where, camera_options(**{**EXACT, **options}))
    drones, step, batches = hovering(len(where.agents)), 0, []
    for k in range(1, round(seconds / tick) + 1):
        while (step := cameras.next_step) <= k * tick / STEP:
            cameras.take(drones, step)
        frames, detections = cameras.arrived(k * tick)
        assert not len(frames.agent)
        batches.append(detections)
    return Seen(
        *(
            np.concatenate([getattr(batch, name) for batch in batches])
            for name in ("agent", "tag", "taken", "arrived", "corners")
        )
    )


@pytest.mark.parametrize("rate", [1.0, 7.0, 10.0, 30.0, 60.0])
def test_images_are_taken_at_the_cameras_rate(rate: float) -> None:
    detections = watched(room(Camera(rate=rate)), 10.0, latency=0.0)
    assert len(detections.images) == pytest.approx(10 * rate, abs=1)
    assert np.diff([0.0, *detections.images]) == pytest.approx(1 / rate, abs=STEP)


def test_cameras_of_one_rate_take_turns() -> None:
    detections = watched(room(Camera(), None, Camera(), Camera(), Camera()), 2.0)
    first = [detections.taken[detections.agent == row].min() for row in (0, 2, 3, 4)]
    assert first == pytest.approx([0.025, 0.05, 0.075, 0.1], abs=STEP)


def test_each_camera_keeps_its_own_rate() -> None:
    detections = watched(room(Camera(rate=10.0), Camera(rate=4.0)), 5.0, latency=0.0)
    times = [len(np.unique(detections.taken[detections.agent == row])) for row in (0, 1)]
    assert times == pytest.approx([50, 20], abs=1)


def test_images_arrive_after_the_latency() -> None:
    detections = watched(room(Camera()), 3.0, latency=0.2)
    assert detections.arrived - detections.taken == pytest.approx(0.2)


def test_nothing_arrives_before_its_time() -> None:
    cameras = Cameras(room(Camera()), camera_options(**{**EXACT, "latency": 0.5}))
    cameras.take(hovering(1), cameras.next_step)  # at 0.1 s
    assert not len(cameras.arrived(0.599)[1].tag)
    assert len(cameras.arrived(0.601)[1].tag)


def test_unwanted_images_are_not_rendered_nor_affect_others() -> None:
    both = room(Camera(), Camera())
    cameras = Cameras(both, camera_options(**EXACT), lambda row: row == 1)
    while (step := cameras.next_step) <= round(2.0 / STEP):
        cameras.take(hovering(2), step)
    some, every = cameras.arrived(2.0)[1], watched(both, 2.0)
    assert set(some.agent.tolist()) == {1}
    assert (some.taken == every.taken[every.agent == 1]).all()


def test_compiling_delivers_no_image_and_changes_nothing() -> None:
    cold, warm = (Cameras(room(Camera()), camera_options(latency_std=0.0)) for _ in range(2))
    warm.compile(hovering(1))
    images = []
    for cameras in (cold, warm):
        cameras.take(hovering(1), cameras.next_step)
        (image,) = cameras.arrived(1.0)[0].image
        images.append(image)
    assert (images[0] == images[1]).all()


def test_what_arrived_is_handed_out_once() -> None:
    cameras = Cameras(room(Camera()), camera_options(**EXACT))
    cameras.take(hovering(1), cameras.next_step)
    assert len(cameras.arrived(1.0)[1].tag) == 3
    assert not len(cameras.arrived(1.0)[1].tag)


def test_the_latency_jitters_by_its_deviation() -> None:
    detections = watched(room(Camera(rate=50.0)), 20.0, latency=0.2, latency_std=0.02)
    late = (detections.arrived - detections.taken)[detections.tag == 0]
    assert np.mean(late) == pytest.approx(0.2, abs=0.003)
    assert np.std(late) == pytest.approx(0.02, rel=0.1)


def test_no_image_arrives_before_it_was_taken() -> None:
    detections = watched(room(Camera(rate=50.0)), 5.0, latency=0.0, latency_std=0.05)
    assert (detections.arrived >= detections.taken).all()


def test_what_comes_in_one_tick_is_in_the_order_of_its_arrival() -> None:
    where = room(Camera(rate=50.0), Camera(rate=50.0))
    detections = watched(where, 5.0, tick=0.5, latency_std=0.05)
    assert (np.diff(detections.arrived) >= 0).all()
    assert (np.diff(detections.taken) < 0).any()  # though they overtake one another


def test_simultaneous_images_are_in_agent_order() -> None:
    cameras = Cameras(room(Camera(rate=10.0), Camera(rate=20.0)), camera_options(**EXACT))
    cameras.take(hovering(2), cameras.next_step)  # both at 0.05 s
    _, detections = cameras.arrived(5.0)
    assert np.unique(detections.taken).tolist() == [0.05]
    assert detections.agent.tolist() == [0, 0, 0, 1, 1, 1]


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_share_of_the_images_never_arrives(share: float) -> None:
    detections = watched(room(Camera(rate=50.0)), 20.0, latency=0.0, drop_rate=share)
    assert len(detections.images) / 1000 == pytest.approx(1 - share, abs=0.05)


def test_a_lost_image_does_not_change_the_next() -> None:
    all_of_them = watched(room(Camera(rate=50.0)), 2.0, corner_noise_std=0.5)
    some = watched(room(Camera(rate=50.0)), 2.0, corner_noise_std=0.5, drop_rate=0.5)
    kept = np.isin(all_of_them.taken, some.taken)
    assert 0 < np.count_nonzero(kept) < len(kept)
    assert np.array_equal(all_of_them.corners[kept], some.corners)


def test_a_share_of_the_tags_is_taken_for_others() -> None:
    detections = watched(room(Camera(rate=50.0)), 20.0, wrong_id_rate=0.3)
    right = np.tile([0, 1, 9], len(detections.tag) // 3)
    assert np.mean(detections.tag != right) == pytest.approx(0.3, abs=0.03)
    assert set(detections.tag.tolist()) == {0, 1, 9}


def pictures(**options: Any) -> list[set[int]]:
    """Which tags OpenCV finds in rendered images."""
    cameras = Cameras(
        room(Camera(rate=50.0)), camera_options(**{**EXACT, "mode": "rendered"}, **options)
    )
    drones = hovering(1)
    while (step := cameras.next_step) * STEP <= 2.0:
        cameras.take(drones, step)
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    detector = cv2.aruco.ArucoDetector(family)
    markers = [detector.detectMarkers(image) for image in cameras.arrived(9.0)[0].image]
    return [{int(n) for n in np.ravel(ids)} if corners else set() for corners, ids, _ in markers]


def test_rendered_tags_bear_the_patterns_of_others() -> None:
    right = pictures()
    assert right.count({0, 1, 9}) > 0.9 * len(right)
    wrong = pictures(wrong_id_rate=0.1)
    # All three are right with 0.9³; two of three bear one pattern else, or all change places.
    assert wrong.count({0, 1, 9}) == pytest.approx(0.9**3 * len(wrong), abs=0.12 * len(wrong))
    assert set().union(*wrong) == {0, 1, 9}


def test_covered_landmarks_and_targets_are_not_seen() -> None:
    detections = watched(room(Camera()), 1.0, covered=("floor", "survivor"))
    assert set(detections.tag.tolist()) == {1}


def test_with_all_of_them_covered_nothing_is_seen() -> None:
    detections = watched(
        room(Camera()), 1.0, covered=("floor", "rug", "survivor"), wrong_id_rate=1.0
    )
    assert not len(detections.tag)


def test_images_without_timestamps_have_no_exposure_time() -> None:
    detections = watched(room(Camera()), 1.0, timestamps=False)
    assert np.isnan(detections.taken).all()
    assert np.isfinite(detections.arrived).all()


def test_corners_are_where_the_real_tags_are_seen() -> None:
    detections = watched(room(Camera()), 0.5)
    tags, corners = OnboardDetector(Camera(), [*TAGS, TARGET], room().world, noise=0.0).detect(
        Shot(np.array([0, 0, 0.8]), np.array([0.0, 0, 0, 1]), np.zeros(3), np.zeros(3))
    )
    assert detections.tag[:3].tolist() == tags.tolist() == [0, 1, 9]
    assert detections.corners[:3] == pytest.approx(corners)


def test_tags_on_the_optical_axis_appear_at_the_principal_point() -> None:
    camera = Camera(position=(0.0, 0.0, 0.0), distortion=(0.0, 0.0, 0.0, 0.0, 0.0))
    detections = watched(room(camera), 0.5)
    middle = detections.corners[detections.tag == 0][0].mean(axis=0)
    assert middle == pytest.approx(camera.matrix[2:], abs=2.0)  # a slanted square's mean is not it


@pytest.mark.parametrize(
    "error",
    [
        {"survey_std": 0.02},
        {"survey_yaw_std_deg": 1.0},
        {"mounting_std_deg": 1.0},
        {"mounting_position_std": 0.02},
    ],
)
def test_true_tags_and_cameras_differ_from_those_of_the_mission(error: dict[str, float]) -> None:
    exact, real = watched(room(Camera()), 0.5), watched(room(Camera()), 0.5, **error)
    moved = np.abs(real.corners[:3] - exact.corners[:3]).max()
    assert 0.1 < moved < 60
    assert np.array_equal(real.corners[:3], real.corners[3:6])  # it is the same all the flight


def test_corners_are_noisy_by_their_deviation() -> None:
    exact = watched(room(Camera(rate=50.0)), 10.0)
    noisy = watched(room(Camera(rate=50.0)), 10.0, corner_noise_std=0.4)
    assert np.std(noisy.corners - exact.corners) == pytest.approx(0.4, rel=0.05)


def test_one_cameras_images_do_not_depend_on_another_camera() -> None:
    how = {"corner_noise_std": 0.4, "mounting_std_deg": 0.6, "latency_std": 0.02}
    alone = watched(room(Camera(), None), 2.0, **how)
    both = watched(room(Camera(), Camera()), 2.0, **how)
    first, second = alone.corners[:3], both.corners[both.agent == 0][:3]
    assert np.array_equal(first, second)


def test_one_seed_gives_one_flight_and_another_another() -> None:
    first, same, other = (
        watched(room(Camera(), seed=seed), 1.0, corner_noise_std=0.4) for seed in (1, 1, 2)
    )
    assert np.array_equal(first.corners, same.corners)
    assert not np.array_equal(first.corners, other.corners)


def test_rendered_images_have_the_cameras_size_and_a_time() -> None:
    camera = Camera(width=160, height=120, matrix=(90.0, 90.0, 80.0, 60.0))
    cameras = Cameras(room(camera), camera_options(latency_std=0.0))
    cameras.take(hovering(1), cameras.next_step)
    frames, detections = cameras.arrived(1.0)
    (image,) = frames.image
    assert image.shape == (120, 160)
    assert image.dtype == np.uint8
    assert image.std() > 5  # it shows something
    assert (frames.taken[0], frames.arrived[0]) == pytest.approx((0.1, 0.25))
    assert not len(detections.tag)


@pytest.mark.parametrize("pixels", ["bayer_rggb", "bayer_gbrg"])
def test_a_color_camera_sends_its_mosaic(pixels: str) -> None:
    images = []
    for kind in ("gray", pixels):
        cameras = Cameras(room(Camera(pixels=kind)), camera_options(pixel_noise_std=0.0))
        cameras.take(hovering(1), cameras.next_step)
        images.append(cameras.arrived(1.0)[0].image[0].astype(float))
    gray, mosaic = images
    for row, column, color in zip((0, 0, 1, 1), (0, 1, 0, 1), pixels[-4:], strict=True):
        of_kind = np.s_[row::2, column::2]
        response = COLOR_RESPONSE[color]
        np.testing.assert_allclose(mosaic[of_kind], response * gray[of_kind], atol=1)
    read = gray_from_mosaic(mosaic.astype(np.uint8), pixels)
    assert np.corrcoef(read.ravel(), gray.ravel())[0, 1] > 0.99


def heard(where: Scene, camera: dict[str, Any]) -> tuple[int, int]:
    """How many images and tags a whole simulator hands out while an agent rises."""
    simulator = star_sim.make(where, **fill_defaults({"camera": camera}, star_sim.OPTIONS))
    simulator.connect()
    row = np.zeros(1, np.int64)
    simulator.command(Command(Order.TAKEOFF, row, np.array([[0, 0, 0.8]]), np.zeros(1), np.ones(1)))
    images = tags = 0
    for tick in range(1, 41):
        simulator.wait(tick * 0.05)
        now = simulator.receive()
        images += len(now.frames.agent)
        tags += len(now.detections.tag)
    return images, tags


@pytest.mark.parametrize(
    ("camera", "options", "images", "sends_tags"),
    [
        (Camera(), {"latency_std": 0.0}, 18, False),
        (Camera(), {"mode": "geometric"}, 0, True),
        (Camera(), {"mode": "off"}, 0, False),
        (None, {}, 0, False),
    ],
)
def test_a_simulator_sends_images_or_tags(
    camera: Camera | None, options: dict[str, Any], images: int, *, sends_tags: bool
) -> None:
    count, tags = heard(room(camera), options)
    assert count == images
    assert (tags > 5) == (tags > 0) == sends_tags


def test_without_a_camera_there_is_nothing_to_send() -> None:
    cameras = Cameras(room(None), camera_options())
    assert cameras.next_step == NEVER
    frames, detections = cameras.arrived(5.0)
    assert (len(frames.agent), len(detections.tag)) == (0, 0)


def test_cameras_do_not_change_how_agents_fly() -> None:
    def where(camera: Camera | None) -> Array:
        simulator = star_sim.make(
            room(camera), **fill_defaults({"camera": {"mode": "geometric"}}, star_sim.OPTIONS)
        )
        simulator.connect()
        for tick in range(1, 41):
            simulator.wait(tick * 0.05)
        truth = simulator.truth()
        assert truth is not None
        return truth.position

    assert np.array_equal(where(Camera()), where(None))


def test_covering_what_is_not_there_is_refused() -> None:
    problems = list(
        star_sim.check(room(Camera()), camera={"covered": ["floor", "flor", "survivor"]})
    )
    assert [(problem.path, problem.message) for problem in problems] == [
        (("camera", "covered", 1), "world 'room' has no landmark 'flor'; did you mean 'floor'?")
    ]
