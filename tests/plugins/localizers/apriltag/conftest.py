"""A flight around a circle: its odometry and images are exact, or have given errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

import star_apriltag
from star_apriltag.agent_estimator import Settings
from star_apriltag.localizer import AprilTag
from star_apriltag.vision.body_pose import View
from star_apriltag.vision.tag_poses import corner_std
from star_core import (
    Agent,
    Array,
    Camera,
    Detections,
    Estimate,
    Fence,
    Image,
    Odometry,
    Pose,
    Scene,
    Supervisor,
    Tag,
    Telemetry,
    World,
)
from star_core.toolkit import CameraModel, fill_defaults, rotation_from_quaternion, square_corners
from star_core.world.quaternions import Quaternion, turned
from tests.plugins.localizers.vision.conftest import tag_corners

RADIUS, SPEED, HEIGHT = 1.0, 0.28, 0.8  # m, m/s and m
RATE = SPEED / RADIUS  # rad/s
CYCLE, TICK = 0.01, 0.05  # s, between samples and between ticks
CAMERA = Camera(readout=0.0)  # then an image shows one moment
LENS = CameraModel(CAMERA)
LEVEL = np.array([0.0, 0.0, 1.0])  # up, in the frame of a body that is not tilted
AHEAD = 1.28  # m, from the centre: what the camera looks at
SIZE, APART = 0.168, 0.21  # m, of a tag and between the two of a sheet
FARTHEST = 2.0  # m: a tag further away is not made out
WIDEST = 2.0  # tangent of an angle from the optical axis that is beyond all corners of the image
TARGET = Tag(200, SIZE, (0.6, 1.15, 0.0), turned(0, 0, 0.4), "survivor")

SETTINGS = Settings(
    method="filter",
    max_tags_per_landmark=2,
    latency=0.15,
    latency_std=0.025,
    mounting_std=0.02,
    survey_std=0.005,
    survey_turn_std=0.01,
    guided_matching=True,
    floor_odometry=False,
)

Change = Callable[[Telemetry], Telemetry]


def sheets(count: int = 6, centre: tuple[float, float] = (0.0, 0.0), first: int = 0) -> list[Tag]:
    """Sheets of two tags each, around the circle."""
    tags = []
    for k in range(count):
        angle = math.tau * (k + 0.5) / count
        for j in range(2):
            aside = (j - 0.5) * APART
            x = centre[0] + AHEAD * math.cos(angle) + aside
            place = (x, centre[1] + AHEAD * math.sin(angle), 0.0)
            number = first + 2 * k + j
            tags.append(Tag(number, SIZE, place, turned(0, 0, 0), f"sheet {first // 2 + k}"))
    return tags


class Circle:
    """An agent that flies around a circle, looking along it, from mission time 0 on.

    Args:
        seconds: How long.
        centre: m.
        scale: What the odometry's velocities must be multiplied by to be right.
        yaw_bias: Of its gyro, rad/s.
        seed: None for odometry that errs by nothing else; else of a Flow deck's errors, by which
            the scale and the bias are drawn as well, and by which it begins a little beside.
    """

    def __init__(
        self,
        seconds: float,
        *,
        centre: tuple[float, float] = (0.0, 0.0),
        scale: complex = 1.0,
        yaw_bias: float = 0.0,
        seed: int | None = None,
    ) -> None:
        self.centre = centre
        self.time = np.linspace(CYCLE, seconds, round(seconds / CYCLE))
        n = len(self.time)
        self.velocity = np.full(n, SPEED / scale, complex)
        self.yaw_rate = np.full(n, RATE + yaw_bias)
        self.beside = np.zeros(3)  # m, m and rad: where it begins against where it should
        if seed is not None:
            rng = np.random.default_rng(seed)
            turn = math.radians(1.0) * rng.normal()
            floor = 1 + 0.05 * rng.normal() + _texture(rng, SPEED * self.time)
            self.velocity = SPEED * floor * complex(math.cos(turn), math.sin(turn))
            self.velocity += 0.004 * complex(*rng.normal(size=2))
            self.velocity += 0.0228 * (rng.normal(size=n) + 1j * rng.normal(size=n))
            self.yaw_rate += math.radians(0.17) * rng.normal()
            self.yaw_rate += math.radians(0.14) * rng.normal(size=n)
            self.beside = rng.normal(size=3) * [0.02, 0.02, math.radians(1.0)]

    def body(self, time: float) -> Pose:
        """Where it really is."""
        angle = RATE * time + self.beside[2]
        x, y = RADIUS * math.cos(angle), RADIUS * math.sin(angle)
        x0, y0 = RADIUS * (math.cos(self.beside[2]) - 1), RADIUS * math.sin(self.beside[2])
        place = [
            self.centre[0] + x - x0 + self.beside[0],
            self.centre[1] + y - y0 + self.beside[1],
            HEIGHT,
        ]
        return Pose(rotation_from_quaternion(turned(0, 0, angle + math.pi / 2)), np.array(place))

    def odometry(self, begin: float, end: float, row: int = 0) -> Odometry:
        """What it streams after `begin` and up to `end`, s."""
        k = np.flatnonzero((self.time > begin + 1e-9) & (self.time <= end + 1e-9))
        velocity = self.velocity[k]
        zero = np.zeros(len(k))
        return Odometry(
            agent=np.full(len(k), row),
            time=self.time[k],
            velocity=np.column_stack([velocity.real, velocity.imag, zero]),
            yaw_rate=self.yaw_rate[k],
            roll=zero,
            pitch=zero,
            height=zero,
        )

    def agent(self, camera: Camera | None = CAMERA) -> Agent:
        """The agent of a scene."""
        x, y = self.centre
        return Agent("cf1", (x + RADIUS, y, HEIGHT), math.pi / 2, camera=camera)


def _texture(rng: np.random.Generator, way: Array) -> Array:
    """An error of the scale along a way, correlated over about 0.7 m."""
    white = rng.normal(size=round(way[-1] / 0.1) + 50)
    smooth = np.convolve(white, np.exp(-((np.arange(-30, 31) * 0.1 / 0.7) ** 2)), "same")
    on_the_way: Array = 0.045 * np.interp(way, 0.1 * np.arange(len(smooth)), smooth / smooth.std())
    return on_the_way


def room(
    circles: Sequence[Circle], tags: Sequence[Tag], *, camera: Camera | None = CAMERA
) -> Scene:
    """Agents on circles over landmarks, and a target."""
    return Scene(
        agents=tuple(
            replace(circle.agent(camera), name=f"cf{k}") for k, circle in enumerate(circles)
        ),
        period=TICK,
        world=World(
            "room", Fence((-20, -20, 0), (20, 20, 3)), landmarks=tuple(tags), targets=(TARGET,)
        ),
    )


def localizer(scene: Scene, **changes: Any) -> AprilTag:
    """The localizer with its default options, but for some."""
    options = fill_defaults({"processes": 0} | changes, star_apriltag.OPTIONS)
    made = star_apriltag.make(scene, **options)
    assert isinstance(made, AprilTag)
    return made


def tags_seen(body: Pose, tags: Sequence[Tag]) -> dict[int, Array]:
    """The (4, 2) corners of the tags that are wholly in the image, by their numbers."""
    pixels = zip(tags, _pixels(body, tags), strict=True)
    return {tag.id: corners for tag, corners in pixels if corners is not None}


def _pixels(body: Pose, tags: Sequence[Tag]) -> list[Array | None]:
    """As `seen`, but None for what is far away, and where the lens model folds back."""
    position = np.array([tag.position for tag in tags]).reshape(-1, 3)
    near = np.linalg.norm(position - body.position, axis=1) <= FARTHEST
    x, y, z = (body @ LENS.mounting).inverse().apply(position).T
    near &= np.hypot(x, y) < WIDEST * z
    return [
        _corners(body, tag) if is_near else None for tag, is_near in zip(tags, near, strict=True)
    ]


def _corners(body: Pose, tag: Tag) -> Array | None:
    pixels = tag_corners(body, tag, LENS)
    if pixels is None:
        return None
    pose = Pose(rotation_from_quaternion(tag.rotation), np.array(tag.position))
    ahead = (body @ LENS.mounting).inverse().apply(pose.apply(square_corners(tag.size)))
    rays = LENS.undistort(pixels)
    return pixels if np.allclose(rays, ahead[:, :2] / ahead[:, 2:], atol=1e-6) else None


def views(
    body: Pose, tags: Sequence[Tag], real: Sequence[Tag] | None = None
) -> list[tuple[int, View]]:
    """Measurements of the tags in an image, whose true positions may differ from the map's."""
    measured = []
    for tag, pixels in zip(tags, _pixels(body, real or tags), strict=True):
        if pixels is None:
            continue
        pose = Pose(rotation_from_quaternion(tag.rotation), np.array(tag.position))
        eye = (body @ LENS.mounting).position
        spread = corner_std(float(np.linalg.norm(pose.position - eye)), tag.size)
        rays = LENS.undistort(pixels)
        spread /= float(LENS.magnification(rays.mean(axis=0)))
        view = View(pose.apply(square_corners(tag.size)), rays, spread, np.zeros(4))
        measured.append((tag.id, view))
    return measured


def attitude(body: Pose) -> Quaternion:
    return turned(0, 0, body.yaw)


def telemetry(
    circles: Sequence[Circle],
    now: float,
    tags: Sequence[Tag] = (),
    *,
    taken: float | None = None,
    since: float | None = None,
) -> Telemetry:
    """What agents report at a tick, with the tags of an image if one was taken."""
    begin = now - TICK if since is None else since
    bodies = [circle.body(now) for circle in circles]
    frames = [
        Pose(
            rotation_from_quaternion(turned(0, 0, math.pi / 2)),
            np.array([c.centre[0] + RADIUS, c.centre[1], 0.0]),
        )
        for c in circles
    ]
    within = [frame.inverse() @ body for frame, body in zip(frames, bodies, strict=True)]
    n = len(circles)
    streams = [circle.odometry(begin, now, row) for row, circle in enumerate(circles)]
    names = Odometry.__dataclass_fields__
    rows, numbers, corners = [], [], []
    for row, circle in enumerate(circles):
        if taken is not None:
            visible = tags_seen(circle.body(taken), tags)
            rows += [row] * len(visible)
            numbers += list(visible)
            corners += list(visible.values())
    when = np.full(len(rows), np.nan if taken is None else taken)
    return Telemetry(
        time=now,
        position=np.array([body.position - [0.0, 0.0, HEIGHT] for body in within]),
        velocity=np.array([body.rotation[:, 0] * SPEED for body in within]),
        attitude=np.array([attitude(body) for body in within]),
        battery=np.full(n, 4.0),
        state=np.full(n, int(Supervisor.FLYING)),
        age=np.zeros(n),
        odometry=Odometry(
            **{name: np.concatenate([getattr(s, name) for s in streams]) for name in names}
        ),
        detections=Detections(
            agent=np.array(rows, np.int64),
            tag=np.array(numbers, np.int64),
            corners=np.array(corners).reshape(-1, 4, 2),
            taken=when,
            arrived=when + 0.15,
        ),
    )


def ticks(
    circles: Sequence[Circle],
    seconds: float,
    tags: Sequence[Tag] = (),
    *,
    latency: float = 0.15,
    every: int = 2,
) -> Iterator[Telemetry]:
    """What agents report in each tick; every so many ticks comes what a camera saw."""
    for k in range(1, round(seconds / TICK) + 1):
        now = k * TICK
        has_image = k % every == 0 and now > latency
        yield telemetry(circles, now, tags, taken=round(now - latency, 9) if has_image else None)


def flown(
    made: AprilTag,
    circles: Sequence[Circle],
    seconds: float,
    tags: Sequence[Tag] = (),
    *,
    change: Change = lambda heard: heard,
    latency: float = 0.15,
) -> list[Estimate]:
    """Every estimate of a flight, what was heard being changed on its way."""
    heard = ticks(circles, seconds, tags, latency=latency)
    return [made.locate(change(report)) for report in heard]


def flight(
    circle: Circle,
    tags: Sequence[Tag] = (),
    *,
    landmarks: Sequence[Tag] | None = None,
    camera: Camera | None = CAMERA,
    change: Change = lambda heard: heard,
    **options: Any,
) -> list[Estimate]:
    """Return every estimate of a flight around a circle over landmarks, some of which are seen."""
    scene = room([circle], sheets() if landmarks is None else landmarks, camera=camera)
    return flown(localizer(scene, **options), [circle], circle.time[-1], tags, change=change)


def off(estimates: Sequence[Estimate], circle: Circle, row: int = 0) -> Array:
    """How far each estimate is from the truth, m."""
    return np.array(
        [np.linalg.norm(e.position[row] - circle.body(e.time).position) for e in estimates]
    )


def marked(tag: int) -> Image:
    """A white image with a tag at columns 100 to 200 of rows 80 to 180."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    image = blank(255)
    image[80:180, 100:200] = cv2.aruco.generateImageMarker(family, tag, 100)
    return image


def blank(value: int = 0, height: int = 244, width: int = 324) -> Image:
    return np.full((height, width), value, np.uint8)
