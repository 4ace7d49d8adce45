"""Speed and sharpness of the simulator's camera, against the naive way to make the same picture.

``python benchmarks/camera.py`` prints a table, with ``--json`` one JSON object. The peer warps the
floor and each tag over the full frame with OpenCV, twice as fine along each side, once for each
slice of the exposure, bends the result by a map, and adds blur, falling off and noise. It has no
rolling shutter, no motion within a slice and no obstacles. Both run on one thread, in turns. The
picture has two tags 1.2 m away; the drone flies at 0.3 m/s and turns at 30 °/s.
"""

from __future__ import annotations

import dataclasses
import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from printed import command_line, show

from star_core import Array, Camera, Fence, Image, Tag, World
from star_sim.camera_sim.camera_pose import Shot, mounting, optics, poses, rays
from star_sim.camera_sim.floor_texture import SIDE, TEXEL, Floor, floor
from star_sim.camera_sim.geometric import OnboardDetector
from star_sim.camera_sim.renderer import MIN_SLICES, Renderer
from star_sim.camera_sim.sensor import vignette
from star_sim.camera_sim.tag_rasterizer import CELLS, MODULES, corners, prints, tag_frames

ROUNDS, TIMES, LOOKS = 15, 10, 150
FINE = 2  # times as fine along each side
ROOM = World("room", Fence((-5.0, -5.0, 0.0), (5.0, 5.0, 3.0)))
FLAT = (0.0, 0.0, 0.0, 1.0)  # a quaternion
PAIR = tuple(Tag(i, 0.168, (0.85, 0.105 - 0.21 * i, 0.0), FLAT, "pair") for i in range(2))
MIDDLE = (FINE - 1) / 2  # fine pixels from the middle of the first one to that of the first pixel
NOISE, BLUR = 4.0, 0.7


class Naive:
    """The peer: full frames, warped by OpenCV."""

    def __init__(self, camera: Camera, tags: tuple[Tag, ...], ground: Floor) -> None:
        self._camera, self._mount = camera, mounting(camera)
        self._lens = optics(camera)._replace(readout=0.0)
        fx, fy, cx, cy = camera.matrix
        self._matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        # Straight images are wider than bent ones; theirs is the field of all directions.
        x, y = rays(camera)
        self._corner = FINE * (fx * x.min() + cx), FINE * (fy * y.min() + cy)
        self._size = (
            math.ceil(FINE * fx * (x.max() - x.min())),
            math.ceil(FINE * fy * (y.max() - y.min())),
        )
        finer = dataclasses.replace(
            camera,
            width=FINE * camera.width,
            height=FINE * camera.height,
            matrix=(FINE * fx, FINE * fy, FINE * cx + MIDDLE, FINE * cy + MIDDLE),
        )
        fine_x, fine_y = rays(finer)
        self._bend = (
            (FINE * (fx * fine_x + cx) - self._corner[0]).astype(np.float32),
            (FINE * (fy * fine_y + cy) - self._corner[1]).astype(np.float32),
        )
        once = ground.texels[: SIDE**2].reshape(SIDE, SIDE)
        self._ground = np.tile(once, (2, 2))
        self._prints = [np.kron(cells, np.ones((8, 8))).astype(np.uint8) for cells in prints(tags)]
        self._rims = corners(tag_frames(tags), CELLS / MODULES)
        self._share = vignette(camera)

    def render(self, shot: Shot, rng: np.random.Generator) -> Image:
        """Return the (height, width) image of a shot."""
        track = poses(shot.packed(), self._mount, self._lens, MIN_SLICES)[0]
        total = np.zeros((self._camera.height, self._camera.width), np.float32)
        half = SIDE * TEXEL
        ground = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
        for pose in track:
            canvas = cv2.warpPerspective(
                self._ground, self._warp(pose, ground, 2 * SIDE), self._size, borderValue=115
            )
            for image, rim in zip(self._prints, self._rims, strict=True):
                warp = self._warp(pose, rim[[3, 2, 1, 0]], len(image))
                cv2.warpPerspective(
                    image, warp, self._size, dst=canvas, borderMode=cv2.BORDER_TRANSPARENT
                )
            bent = cv2.remap(canvas, *self._bend, cv2.INTER_LINEAR)
            total += cv2.resize(bent, total.shape[::-1], interpolation=cv2.INTER_AREA)
        light = cv2.GaussianBlur(total / len(track), (5, 5), BLUR) * self._share
        light += NOISE * rng.standard_normal(light.shape, np.float32)
        return np.asarray(np.clip(light, 0, 255), np.uint8)

    def _warp(self, pose: Array, square: Array, side: int) -> Array:
        """Homography from an image of some side to the canvas, for a square from its upper left."""
        turn, place = pose[:9].reshape(3, 3), pose[9:]
        right, down = (square[1] - square[0]) / side, (square[3] - square[0]) / side
        first = square[0] + 0.5 * (right + down)  # the middle of the first pixel
        flat = turn.T @ np.stack([right, down, first - place], axis=1)
        shift = np.array([[FINE, 0, -self._corner[0]], [0, FINE, -self._corner[1]], [0, 0, 1]])
        return np.asarray(shift @ self._matrix @ flat)


def shots(count: int) -> list[Shot]:
    """Shots of a drone that flies past the tags, turning."""
    return [
        Shot(
            np.array([0.02 * math.sin(k), 0.05 * math.cos(k), 0.8]),
            np.array([0.0, 0.0, math.sin(0.05 * math.sin(k)), math.cos(0.05 * math.sin(k))]),
            np.array([0.3, 0.0, 0.0]),
            np.array([0.0, 0.0, math.radians(30)]),
        )
        for k in range(count)
    ]


def milliseconds(call: Callable[[Shot], Any]) -> float:
    """Mean CPU time of one call over some shots, ms."""
    began = time.thread_time()
    for shot in shots(TIMES):
        call(shot)
    return 1e3 * (time.thread_time() - began) / TIMES


def speed() -> dict[str, float]:
    """Times of one picture, ms, and ratios to the peer's."""
    ground, camera = floor(0), Camera()
    rng = np.random.default_rng(0)
    ours = Renderer(camera, PAIR, ROOM, ground, noise=NOISE, blur=BLUR)
    bare = Renderer(camera, (), ROOM, ground, noise=0.0, blur=0.0)
    single = Renderer(camera, PAIR[:1], ROOM, ground, noise=NOISE, blur=BLUR)
    detector, naive = OnboardDetector(camera, PAIR, ROOM), Naive(camera, PAIR, ground)
    calls: dict[str, Callable[[Shot], Any]] = {
        "two_tags": lambda shot: ours.render(shot, rng),
        "one_tag": lambda shot: single.render(shot, rng),
        "floor_only": lambda shot: bare.render(shot, rng),
        "geometric": lambda shot: detector.detect(shot, rng),
        "naive": lambda shot: naive.render(shot, rng),
    }
    for call in calls.values():
        call(shots(1)[0])
    table = [{name: milliseconds(call) for name, call in calls.items()} for _ in range(ROUNDS)]
    figures = {f"{name}_ms": statistics.median(row[name] for row in table) for name in calls}
    figures["beyond_floor_ms"] = statistics.median(r["two_tags"] - r["floor_only"] for r in table)
    figures["two_tags_over_naive"] = statistics.median(r["two_tags"] / r["naive"] for r in table)
    return figures


def likeness() -> dict[str, float]:
    """How far the peer's picture is from ours: it must be the same picture to be a peer."""
    ground, rng = floor(0), np.random.default_rng(0)
    camera = Camera(readout=0.0)
    ours = Renderer(camera, PAIR, ROOM, ground, noise=0.0, blur=BLUR).render(shots(1)[0], rng)
    theirs = Naive(camera, PAIR, ground).render(shots(1)[0], rng).astype(float)
    (left, top), (right, bottom) = (
        reach(OnboardDetector(camera, PAIR, ROOM).detect(shots(1)[0])[1].reshape(-1, 2), axis=0)
        for reach in (np.min, np.max)
    )
    part = np.s_[int(top) - 5 : int(bottom) + 6, int(left) - 5 : int(right) + 6]
    return {
        "peer_correlation_at_tags": float(
            np.corrcoef(ours[part].ravel(), theirs[part].ravel())[0, 1]
        )
    }


def recall(count: int) -> dict[str, float]:
    """Share of the tags wholly in view that OpenCV's detector finds as it comes, by distance."""
    tags = [
        Tag(9 * i + j, 0.168, (0.6 * i - 2.4, 0.6 * j - 2.4, 0.0), FLAT, f"{i} {j}")
        for i in range(9)
        for j in range(9)
    ]
    place = {tag.id: tag.position for tag in tags}
    camera, rng = Camera(), np.random.default_rng(0)
    renderer = Renderer(camera, tags, ROOM, floor(0))
    every_tag = OnboardDetector(camera, tags, ROOM, min_module=0.0)
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    detector = cv2.aruco.ArucoDetector(family)
    looks: list[tuple[float, bool]] = []
    for _ in range(count):
        heading = rng.uniform(-math.pi, math.pi)
        shot = Shot(
            np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(0.6, 1.0)]),
            np.array([0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)]),
            rng.normal(0.0, 0.15, 3),
            rng.normal(0.0, 0.2, 3),
        )
        squares, ids, _ = detector.detectMarkers(renderer.render(shot, rng))
        numbers = set(np.ravel(ids).tolist()) if squares else set()
        eye = shot.position + np.array([0.0, 0.0, camera.position[2]])
        looks += [
            (float(np.linalg.norm(place[n] - eye)), n in numbers)
            for n in every_tag.detect(shot)[0].tolist()
        ]
    bounds = [(0.0, 1.0), (1.0, 1.3), (1.3, 1.6), (1.6, 2.0), (2.0, 3.0)]
    return {
        f"recall_{low:g}_to_{high:g}_m": float(
            np.mean([hit for distance, hit in looks if low <= distance < high])
        )
        for low, high in bounds
    }


def main() -> None:
    options = command_line(__doc__).parse_args()
    cv2.setNumThreads(1)
    show(speed() | likeness() | recall(LOOKS), as_json=options.json)


if __name__ == "__main__":
    main()
