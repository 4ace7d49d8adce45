"""How well tags are found, and how long an image takes.

``python benchmarks/detector.py [PHOTOS]``: images of 324 by 244 px, scenes of small tags, and the
photographs of a folder if one is given (`small_tags`).

In the images of 324 by 244 px, pairs of A4 tags on the simulator's floor are looked at from a
moving agent, 0.8 m high. Ours and OpenCV's detector with its own windows and sub-pixel corners see
the same images in turns, on one core; times are what that core worked, and ratios are medians over
images. A corner's error is its distance from where the simulator's camera, row by row, had it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import thread_time_ns
from typing import Any, NamedTuple

import cv2
import numpy as np
from printed import command_line, show
from small_tags import CONDITIONS, photographs, scenes

from star_apriltag.vision.body_pose import Motion, Prediction
from star_apriltag.vision.detector import Detector
from star_apriltag.vision.image_analysis import ImageAnalyzer
from star_core import Array, Camera, Fence, Image, Pose, Rows, Tag, World
from star_core.toolkit import CameraModel, rotation_from_quaternion, square_corners
from star_core.world.quaternions import turned
from star_sim.camera_sim.camera_pose import Shot
from star_sim.camera_sim.floor_texture import floor
from star_sim.camera_sim.renderer import Renderer

HEIGHT, SPEED, TURN, TILT = 0.8, 0.28, 0.8, 0.035  # m, m/s, greatest rad/s, deviation in rad
SIZE, SPACING, FARTHEST = 0.168, 0.21, 1.5  # m; farther tags are in the images but do not count
NEAREST = 0.05  # m, ahead of the camera
ORDER = [3, 2, 1, 0]  # from corners clockwise from the top left to ours
EDGE = 5.0  # px: a tag nearer to the edge of the image does not count either


class Case(NamedTuple):
    """An image, and what is in it.

    Attributes:
        image: As rendered.
        tags: Those that lie there.
        corners: Their (4, 2) corners by number, px, of those that count.
        prediction: Where the body is.
    """

    image: Image
    tags: Sequence[Tag]
    corners: dict[int, Array]
    prediction: Prediction


class Score:
    """What one detector did."""

    def __init__(self) -> None:
        self.squares: list[float] = []
        self.times: list[int] = []
        self.wrong = 0

    def add(self, case: Case, tags: Rows, corners: Array, time: int) -> None:
        """Take in what was found in one image, and the time it took, ns."""
        self.times.append(time)
        numbers = {tag.id for tag in case.tags}
        for tag, pixels in zip(tags.tolist(), corners, strict=True):
            self.wrong += tag not in numbers
            if tag in case.corners:
                off = pixels - case.corners[tag]
                self.squares.append(float((off * off).sum(axis=1).mean()))


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    parser = command_line(__doc__, images=200, scenes=6, tags=25)
    parser.add_argument("photos", nargs="?", type=Path, help="a folder of photographs")
    parser.add_argument(
        "--conditions", nargs="+", choices=[*CONDITIONS], default=[*CONDITIONS], help="of scenes"
    )
    options = parser.parse_args()
    cv2.setNumThreads(1)
    figures = compare(list(cases(options.images))) | scenes(
        options.scenes, options.tags, options.conditions
    )
    if options.photos is not None:
        figures |= photographs(options.photos)
    show(figures, as_json=options.json)


def compare(images: Sequence[Case]) -> dict[str, float]:
    """Return every figure by its name."""
    peer = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), _subpixel()
    )
    detector, ours, theirs = Detector(CameraModel(Camera())), Score(), Score()
    whole: list[int] = []
    for case in images:
        analyzer = ImageAnalyzer(Camera(), case.tags, {}, guided_matching=True)
        analyzer.lens.undistort(np.zeros((1, 2)))  # computed once for each camera
        begin = thread_time_ns()
        detections = detector.detect(case.image)
        middle = thread_time_ns()
        quads, tags, _ = peer.detectMarkers(case.image)
        late = thread_time_ns()
        analyzer.analyze(case.image, case.prediction)
        whole.append(thread_time_ns() - late)
        ours.add(case, detections.tag, detections.corners, middle - begin)
        corners = np.reshape(np.array(quads, np.float64), (-1, 4, 2))[:, ORDER]
        numbers = np.array(tags if len(quads) else [], np.int64).ravel()
        theirs.add(case, numbers, corners, late - middle)
    present = sum(len(case.corners) for case in images)
    return {
        "share_found": len(ours.squares) / present,
        "opencv_share_found": len(theirs.squares) / present,
        "corner_rms_px": math.sqrt(float(np.mean(ours.squares))),
        "opencv_corner_rms_px": math.sqrt(float(np.mean(theirs.squares))),
        "wrong_numbers": float(ours.wrong),
        "opencv_wrong_numbers": float(theirs.wrong),
        "detect_ratio": float(np.median(np.divide(ours.times, theirs.times))),
        "analysis_ratio": float(np.median(np.divide(whole, theirs.times))),
        "detect_ms": float(np.median(ours.times)) / 1e6,
        "analysis_ms": float(np.median(whole)) / 1e6,
        "analysis_p95_ms": float(np.percentile(whole, 95)) / 1e6,
        "opencv_ms": float(np.median(theirs.times)) / 1e6,
    }


def cases(count: int) -> Iterator[Case]:
    """Yield images with a tag or two that count."""
    rng = np.random.default_rng(0)
    lens, ground = CameraModel(Camera()), floor(0)
    world = World("floor", Fence((-5.0, -5.0, 0.0), (5.0, 5.0, 3.0)))
    while count:
        yaw, sheet = rng.uniform(-math.pi, math.pi, 2)
        roll, pitch = rng.normal(0, TILT, 2)
        ahead = yaw + rng.uniform(-0.7, 0.7)
        centre = rng.uniform(0.25, FARTHEST) * np.array([math.cos(ahead), math.sin(ahead)])
        along = SPACING / 2 * np.array([math.cos(sheet), math.sin(sheet)])
        tags = [
            Tag(int(number), SIZE, (*(centre + side * along), 0.0), turned(0, 0, sheet), "sheet")
            for number, side in zip(rng.choice(587, 2, replace=False), (-1, 1), strict=True)
        ]
        attitude = turned(roll, pitch, yaw)
        body = Pose(rotation_from_quaternion(attitude), np.array([0.0, 0.0, HEIGHT]))
        velocity = SPEED * np.array([math.cos(yaw), math.sin(yaw), 0.0])
        rates = np.array([0.0, 0.0, rng.uniform(-TURN, TURN)])
        sure = np.diag([0.1, 0.1, 0.07]) ** 2
        prediction = Prediction(body, sure, Motion(velocity @ body.rotation, rates))
        corners = {tag.id: _visible_corners(lens, tag, prediction) for tag in tags}
        counting = {tag: pixels for tag, pixels in corners.items() if pixels is not None}
        if counting:
            count -= 1
            shot = Shot(body.position, np.array(attitude), velocity, rates)
            image = Renderer(Camera(), tags, world, ground).render(shot, rng)
            yield Case(image, tags, counting, prediction)


def _visible_corners(lens: CameraModel, tag: Tag, body: Prediction) -> Array | None:
    """Return the (4, 2) corners of a tag in an image that is read row by row, if it counts."""
    place = Pose(rotation_from_quaternion(tag.rotation), np.array(tag.position))
    still = body.pose.inverse().apply(place.apply(square_corners(tag.size)))
    delay = np.zeros((4, 1))
    for _ in range(4):  # until each corner is where it is when its own row is read
        moved = still + delay * (np.cross(still, body.motion.rates) - body.motion.velocity)
        camera = lens.mounting.inverse().apply(moved)
        if camera[:, 2].min() < NEAREST or np.linalg.norm(camera.mean(axis=0)) > FARTHEST:
            return None
        pixels = lens.project(camera)
        delay = lens.row_delay(pixels)[:, None]
    last = np.array(lens.shape[::-1]) - 1 - EDGE
    return pixels if (pixels >= EDGE).all() and (pixels <= last).all() else None


def _subpixel() -> Any:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return parameters


if __name__ == "__main__":
    main()
