"""What pictures show: looked at with OpenCV's own eyes, and with an edge fit."""

from __future__ import annotations

import dataclasses
import itertools

import cv2
import numpy as np
import pytest

from star_core import Array, Camera, Image, Obstacle, Tag
from star_core.world.quaternions import turned
from star_sim.camera_sim.camera_pose import Shot
from star_sim.camera_sim.geometric import OnboardDetector
from star_sim.camera_sim.renderer import Renderer
from star_sim.camera_sim.tag_rasterizer import INK, PAPER
from tests.plugins.transports.star_sim.camera_sim.conftest import ground, room, take

CAMERA = Camera()
DOWN = dataclasses.replace(CAMERA, pitch=np.pi / 2, distortion=(0.0, 0.0, 0.0, 0.0, 0.0))
UPRIGHT = turned(np.pi / 2, 0, -np.pi / 2)  # hangs, facing -x
DETECTOR = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))


def lying(number: int, x: float, y: float = 0.0, *, yaw: float = 0.0, size: float = 0.168) -> Tag:
    return Tag(number, size, (x, y, 0.0), turned(0, 0, yaw), f"sheet{number}")


def picture(renderer: Renderer, shot: Shot, rng: np.random.Generator | None = None) -> Image:
    return renderer.render(shot, rng or np.random.default_rng(0))


def detected(image: Image) -> dict[int, Array]:
    """Corners of the tags that OpenCV finds, in its order: clockwise from the upper left."""
    corners, ids, _ = DETECTOR.detectMarkers(image)
    numbers = [int(n) for n in np.ravel(ids)] if corners else []
    return {n: np.asarray(c[0], np.float64) for n, c in zip(numbers, corners, strict=True)}


def edge_fit(image: Image, corners: Array, half: float) -> Array:
    """Corners of a tag, (4, 2) px, from lines through where each side is half dark, half light.

    Each profile across a side runs from the black border to the white rim; its edge is where a
    sharp step would have the same sum.
    """
    across = np.linspace(-half, half, 61)
    lines = []
    for start, end in itertools.pairwise([*corners, corners[0]]):
        along = (end - start) / np.linalg.norm(end - start)
        out = np.array([-along[1], along[0]])
        if out @ (start - corners.mean(axis=0)) < 0:
            out = -out
        bases = start + np.linspace(0.2, 0.8, 25)[:, None] * (end - start)
        points = (bases[:, None] + across[:, None] * out).astype(np.float32)
        profile = cv2.remap(
            image.astype(np.float32), points[..., 0], points[..., 1], cv2.INTER_LINEAR
        )
        dark, light = profile[:, :8].mean(), profile[:, -8:].mean()
        middle = half * (1 - 2 * (profile.mean(axis=1) - dark) / (light - dark))
        edges = bases + middle[:, None] * out
        centre = edges.mean(axis=0)
        lines.append((centre, np.linalg.svd(edges - centre)[2][1]))
    corner = []
    for (p, n), (q, m) in zip([lines[-1], *lines[:-1]], lines, strict=True):
        corner.append(np.linalg.solve([n, m], [n @ p, m @ q]))
    return np.array(corner)


def pair() -> Renderer:
    return Renderer(CAMERA, [lying(3, 0.8, 0.105), lying(4, 0.8, -0.105)], room(), ground())


def test_the_same_seed_gives_the_same_bytes() -> None:
    shot = take(velocity=(0.3, 0.1, 0.0), rates=(0.0, 0.1, 0.8))
    first, again, other = (picture(pair(), shot, np.random.default_rng(s)) for s in (5, 5, 6))
    assert first.shape == (244, 324)
    assert first.dtype == np.uint8
    assert (first == again).all()
    assert (first != other).any()


@pytest.mark.parametrize("yaw", [0.0, 1.0, 2.5, -1.2])
def test_a_tag_has_its_rotation(yaw: float) -> None:
    tags = [lying(7, 0.75, yaw=yaw)]
    shot = take()
    ids, corners = OnboardDetector(CAMERA, tags, room()).detect(shot)
    tag_corners = detected(picture(Renderer(CAMERA, tags, room(), ground()), shot))
    assert list(ids) == [7]
    assert tag_corners[7][[3, 2, 1, 0]] == pytest.approx(corners[0], abs=2.0)


def test_unrotated_tags_are_upright_for_a_north_facing_camera() -> None:
    tags = [lying(7, 0.0, 0.75)]  # the map's y axis, hence the tag's, points away from the camera
    corners = detected(
        picture(Renderer(CAMERA, tags, room(), ground()), take(turn=(0, 0, np.pi / 2)))
    )
    upper_left, upper_right, lower_right, lower_left = corners[7]
    assert upper_left[0] < upper_right[0]
    assert lower_left[0] < lower_right[0]
    assert upper_left[1] < lower_left[1]


def test_rendered_edges_are_unbiased_for_any_motion() -> None:
    rng = np.random.default_rng(3)
    errors, directions = [], []
    for number in range(25):
        tag = lying(number, 0.5, yaw=rng.uniform(-3, 3))
        world = room()
        shot = take(
            (*rng.uniform(-0.1, 0.1, 2), 0.45),
            tuple(rng.normal(0, [0.05, 0.05, 0.1])),
            rng.normal(0, 0.3, 3),
            rng.normal(0, 0.5, 3),
        )
        _, corners = OnboardDetector(CAMERA, [tag], world).detect(shot)
        if not len(corners):
            continue
        image = picture(Renderer(CAMERA, [tag], world, ground()), shot, rng)
        errors.append(edge_fit(image, corners[0], 3.0) - corners[0])
        outward = corners[0] - corners[0].mean(axis=0)
        directions.append(outward / np.linalg.norm(outward, axis=1, keepdims=True))
    error, outward = np.array(errors), np.array(directions)
    assert len(error) > 15
    assert np.abs(error.mean(axis=(0, 1))).max() < 0.05  # px: half a pixel off would be seen
    assert abs((error * outward).sum(axis=2).mean()) < 0.1  # not grown, not shrunk
    assert np.sqrt((error**2).mean()) < 0.15


def test_a_picture_is_the_mean_of_one_that_is_four_times_as_fine() -> None:
    camera = dataclasses.replace(CAMERA, readout=0.0)  # whose rows would differ
    fx, fy, cx, cy = camera.matrix
    fine = dataclasses.replace(
        camera,
        width=4 * camera.width,
        height=4 * camera.height,
        matrix=(4 * fx, 4 * fy, 4 * cx + 1.5, 4 * cy + 1.5),
    )
    tag, shot = lying(11, 0.85, yaw=0.4), take(turn=(0.02, -0.03, 0.05), velocity=(0.1, 0.1, 0.0))
    _, corners = OnboardDetector(camera, [tag], room()).detect(shot)
    coarse, many = (
        picture(Renderer(kind, [tag], room(), ground(), noise=0.0, blur=0.0), shot).astype(float)
        for kind in (camera, fine)
    )
    left, top = corners[0].min(axis=0).astype(int) - 3
    right, bottom = corners[0].max(axis=0).astype(int) + 4
    many = many.reshape(244, 4, 324, 4).mean(axis=(1, 3))
    difference = (coarse - many)[top:bottom, left:right]
    assert difference.std() < 2.5  # of the 185 between ink and paper
    assert abs(difference.mean()) < 0.6


def test_tags_are_found_near_and_lost_far() -> None:
    tags = [lying(10 * i + j, 0.45 * i, 0.45 * j - 1.0) for i in range(8) for j in range(6)]
    frame = {tag.id: tag.position for tag in tags}
    renderer, detector = (
        Renderer(CAMERA, tags, room(), ground()),
        OnboardDetector(CAMERA, tags, room()),
    )
    rng = np.random.default_rng(0)
    near, far = [], []
    for yaw in np.linspace(-0.5, 0.5, 10):
        shot = take((*rng.uniform(-0.3, 0.3, 2), 0.7), (0, 0, yaw), rng.normal(0, 0.15, 3))
        tag_corners = detected(picture(renderer, shot, rng))
        within = [
            n for n in detector.detect(shot)[0] if np.linalg.norm(frame[n] - shot.position) < 1.1
        ]
        near += [number in tag_corners for number in within]
        far += [np.linalg.norm(frame[number] - shot.position) for number in tag_corners]
    assert len(near) > 18
    assert np.mean(near) > 0.9
    assert max(far) < 2.2


def test_a_tag_on_a_wall_is_seen_from_its_front_only() -> None:
    tag = Tag(2, 0.168, (1.0, 0.0, 0.5), UPRIGHT, "wall")
    renderer = Renderer(CAMERA, [tag], room(), ground())
    bare = Renderer(CAMERA, [], room(), ground())
    behind = take((1.9, 0, 0.8), (0, 0, np.pi))
    assert list(detected(picture(renderer, take()))) == [2]
    assert (picture(renderer, behind) == picture(bare, behind)).all()


def test_a_tag_hangs_on_the_face_of_an_obstacle() -> None:
    tag = Tag(2, 0.168, (1.0, 0.0, 0.5), UPRIGHT, "wall")
    wall = Obstacle("wall", (((1.0, -2), (1.1, -2), (1.1, 2), (1.0, 2)),), (0.0, 2.0))
    assert list(detected(picture(Renderer(CAMERA, [tag], room(wall), ground()), take()))) == [2]


def test_an_obstacle_hides_what_is_behind_it() -> None:
    wall = Obstacle("wall", (((0.6, -2), (0.62, -2), (0.62, 2), (0.6, 2)),), (0.0, 0.7))
    shot = take()
    hidden = Renderer(CAMERA, [lying(3, 0.8)], room(wall), ground())
    bare = Renderer(CAMERA, [], room(wall), ground())
    plain = Renderer(CAMERA, [], room(), ground())
    assert (picture(hidden, shot) == picture(bare, shot)).all()
    assert (picture(bare, shot) != picture(plain, shot)).mean() > 0.3


def test_a_nearer_tag_hides_a_farther_one() -> None:
    sign = Tag(2, 0.5, (0.6, 0.0, 0.25), UPRIGHT, "sign")
    tag_first = Renderer(CAMERA, [lying(3, 0.9), sign], room(), ground())
    sign_first = Renderer(CAMERA, [sign, lying(3, 0.9)], room(), ground())
    alone = Renderer(CAMERA, [sign], room(), ground())
    shot = take()
    assert (picture(tag_first, shot) == picture(alone, shot)).all()
    assert (picture(sign_first, shot) == picture(alone, shot)).all()


def test_rims_that_touch_leave_no_seam() -> None:
    tags = [lying(3, 0.0, 0.105), lying(4, 0.0, -0.105)]
    renderer = Renderer(DOWN, tags, room(), ground(), noise=0.0)
    shot = take((-0.025, 0.0, 0.485), (0, 0, 0.3))  # over the seam
    image = picture(renderer, shot)
    v, u = round(DOWN.matrix[3]), round(DOWN.matrix[2])
    assert image[v - 1 : v + 2, u - 1 : u + 2].min() > PAPER - 5
    assert image.min() > INK * 0.6


def test_motion_blurs_along_its_way_only() -> None:
    tags = [lying(3, 0.0)]
    camera = dataclasses.replace(DOWN, exposure=0.04, readout=0.0)
    renderer = Renderer(camera, tags, room(), ground(), noise=0.0)

    def sharpness(shot: Shot) -> tuple[float, float]:
        image = picture(renderer, shot).astype(float)[100:220, 100:240]
        return np.abs(np.diff(image, axis=0)).max(), np.abs(np.diff(image, axis=1)).max()

    at = (-0.025, 0.0, 0.485)
    down, right = sharpness(take(at))
    blurred, sharp = sharpness(take(at, velocity=(0.4, 0.0, 0.0)))  # 6 px down the image
    assert blurred < 0.6 * down
    assert sharp > 0.9 * right


def test_the_floor_moves_with_the_camera_as_a_floor_does() -> None:
    renderer = Renderer(DOWN, [], room(), ground(), noise=0.0)
    pixel = 1.0 / 180.05  # m, at one metre
    before = picture(renderer, take((0.0, 0.0, 0.985))).astype(float)
    after = picture(renderer, take((0.0, 10 * pixel, 0.985))).astype(float)
    middle = slice(80, 240), slice(80, 240)
    shifted = slice(80, 240), slice(90, 250)  # to the left: what was left of the middle is in it
    assert np.corrcoef(before[middle].ravel(), after[shifted].ravel())[0, 1] > 0.99
    assert np.corrcoef(before[middle].ravel(), after[middle].ravel())[0, 1] < 0.6


def test_noise_has_the_deviation_it_was_given() -> None:
    rng = np.random.default_rng(0)
    for read in (4.0, 8.0):
        renderer = Renderer(CAMERA, [], room(), ground(), noise=read)
        first, second = (picture(renderer, take(), rng).astype(float) for _ in range(2))
        assert (first - second).std() / np.sqrt(2) == pytest.approx(read, rel=0.03)


def test_light_falls_off_towards_the_corners() -> None:
    sheet = Tag(0, 40.0, (0.0, 0.0, 0.0), turned(0, 0, 0), "vast")  # its rim fills the view
    image = picture(Renderer(DOWN, [sheet], room(), ground(), noise=0.0), take((-22.525, 0, 0.5)))
    assert image[160, 169] == pytest.approx(PAPER, abs=1)
    assert image[0, 0] == pytest.approx(0.7 * PAPER, abs=2)


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (0.0, 0.0, -0.1), (50.0, 80.0, 3.0)])
def test_images_from_odd_poses_are_images(at: tuple[float, ...]) -> None:
    for turn in ((0, 0, 0), (np.pi, 0, 0), (0, -np.pi / 2, 0), (0, np.pi / 4, 1.0)):
        assert picture(pair(), take(at, turn, rates=(5.0, 5.0, 5.0))).std() > 1
