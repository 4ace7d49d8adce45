"""Tags in photographs and in drawn scenes of small tags, by three detectors; see ``detector.py``.

The peers are OpenCV's detector with its defaults and, if ``pupil-apriltags`` is installed, the
AprilTag library at full resolution. A photograph ``NAME.jpg`` may have a reference beside it,
``NAME.txt``: a number and four corners per line, as that library prints them. In that library the
middle of the first pixel is at (0.5, 0.5), in OpenCV and here at (0, 0), which is subtracted.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from star_apriltag.vision.detector import Detector
from star_core import Array, Camera, Image
from star_core.toolkit import CameraModel

FAMILY: Final = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
MODULES: Final = 8
FINE: Final = 5  # times as fine along each side as a scene is drawn
INK, PAPER = 25.0, 225.0  # gray values
SEPARATION: Final = 36.0  # px, between the centers of tags
SQUARE: Final = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])  # bottom left first


class Sighting(NamedTuple):
    """A tag in an image: its number and its (4, 2) corners, px."""

    tag: int
    corners: Array

    def same(self, other: Sighting) -> bool:
        """Return whether both are the same tag."""
        apart = self.corners.mean(axis=0) - other.corners.mean(axis=0)
        size = np.linalg.norm(other.corners[0] - other.corners[2])
        return self.tag == other.tag and bool(np.linalg.norm(apart) < 0.35 * size)

    def distance(self, other: Sighting) -> float:
        """Return the mean distance of the corners, px, wherever the other's order begins."""
        orders = (np.roll(other.corners[::way], k, axis=0) for way in (1, -1) for k in range(4))
        return min(float(np.linalg.norm(self.corners - o, axis=1).mean()) for o in orders)


Detect = Callable[[Image], list[Sighting]]


class Condition(NamedTuple):
    """How a scene is drawn."""

    edges: tuple[float, float] = (10.0, 19.0)  # px, of the tags
    blur: float = 0.6  # px, standard deviation
    noise: float = 3.0  # gray values, standard deviation
    jpeg: int = 90  # quality
    slant: float = 0.75  # least ratio of a tag's axes


CONDITIONS: Final = {
    "small": Condition(),
    "small_jpeg_60": Condition(jpeg=60),
    "small_noise": Condition(noise=6.0),
    "small_blurred": Condition(blur=0.9),
    "small_slanted": Condition(blur=0.45, slant=0.5),
    "smallest": Condition(edges=(9.0, 13.0)),
    "large_blurred": Condition(edges=(60.0, 110.0), blur=3.0),
}


def scenes(count: int, tags: int, conditions: Sequence[str]) -> dict[str, float]:
    """Return shares found, corner errors and false tags in drawn scenes, by condition."""
    figures = {}
    detectors = peers() | {"our": ours}
    for name in conditions:
        drawn = [scene(np.random.default_rng(k), CONDITIONS[name], tags) for k in range(count)]
        present = sum(len(truth) for _, truth in drawn)
        for detector, detect in detectors.items():
            matches, extra, errors = 0, 0, []
            for image, truth in drawn:
                sightings = detect(image)
                pairs = [
                    (sighting, tag) for sighting in sightings for tag in truth if sighting.same(tag)
                ]
                matches += len({tag.tag for _, tag in pairs})
                extra += len(sightings) - len(pairs)
                errors += [sighting.distance(tag) for sighting, tag in pairs]
            figures[f"{name}_{detector}_share_found"] = matches / present
            figures[f"{name}_{detector}_corner_px"] = (
                float(np.median(errors)) if errors else math.nan
            )
            figures[f"{name}_{detector}_false"] = float(extra)
    return figures


def photographs(folder: Path) -> dict[str, float]:
    """Return what each detector finds in the photographs of a folder, and in changed ones."""
    figures: dict[str, float] = {}
    for path in sorted([*folder.glob("*.jpg"), *folder.glob("*.png")]):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        listed = path.with_suffix(".txt")
        for name, changed in variants(np.asarray(image, np.uint8)):
            sightings = {detector: detect(changed) for detector, detect in peers().items()}
            if name == "as_it_is" and listed.is_file():
                sightings["library"] = reference(listed)
            mine = ours(changed)
            figures |= {
                f"{path.stem}_{name}_{w}": float(len(tags)) for w, tags in sightings.items()
            }
            figures[f"{path.stem}_{name}_ours"] = float(len(mine))
            if "library" in sightings:
                pairs = [
                    (sighting, tag)
                    for tag in sightings["library"]
                    for sighting in mine
                    if sighting.same(tag)
                ]
                common, apart = len({id(t) for _, t in pairs}), [a.distance(b) for a, b in pairs]
                figures[f"{path.stem}_{name}_of_the_librarys"] = float(common)
                figures[f"{path.stem}_{name}_apart_px"] = float(np.median(apart or [math.nan]))
    return figures


def variants(image: Image) -> Iterator[tuple[str, Image]]:
    """Yield a photograph, and the same smaller, larger, blurred, with noise and as a poor JPEG."""
    yield "as_it_is", image
    rng = np.random.default_rng(0)
    for scale in (0.5, 0.7, 1.0, 1.6):
        area = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        sized = np.asarray(
            cv2.resize(image, None, fx=scale, fy=scale, interpolation=area), np.uint8
        )
        yield f"x{scale}_blur", np.asarray(cv2.GaussianBlur(sized, (0, 0), 0.8), np.uint8)
        noisy = sized + rng.normal(0, 6, sized.shape)
        yield f"x{scale}_noise", np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        yield f"x{scale}_jpeg", compressed(sized, 40)


def reference(path: Path) -> list[Sighting]:
    """Return the tags that the AprilTag library listed in a file, by OpenCV's pixels."""
    rows = [re.findall(r"[-\d.]+", line) for line in path.read_text().splitlines()]
    return [
        Sighting(int(row[0]), np.array(row[1:], float).reshape(4, 2) - 0.5) for row in rows if row
    ]


def peers() -> dict[str, Detect]:
    """Return the detectors that are compared with ours."""
    return {"opencv": opencv} | ({"library": library()} if find_spec("pupil_apriltags") else {})


def ours(image: Image) -> list[Sighting]:
    """Return what this project's detector finds, with a lens without distortion."""
    height, width = image.shape
    matrix = (float(width), float(width), width / 2, height / 2)
    camera = Camera(width=width, height=height, matrix=matrix, distortion=(0.0, 0.0, 0.0, 0.0, 0.0))
    tags = Detector(CameraModel(camera)).detect(image)
    return [Sighting(*row) for row in zip(tags.tag.tolist(), tags.corners, strict=True)]


def opencv(image: Image) -> list[Sighting]:
    """Return what OpenCV's detector finds with its defaults."""
    quads, tags, _ = cv2.aruco.ArucoDetector(FAMILY).detectMarkers(image)
    return [
        Sighting(int(tag), np.reshape(quad, (4, 2)))
        for quad, tag in zip(quads, np.ravel(tags) if len(quads) else [], strict=True)
    ]


def library() -> Detect:
    """Return the AprilTag library's detector at full resolution."""
    from pupil_apriltags import Detector as Peer

    peer = Peer(families="tag36h11", nthreads=1, quad_decimate=1.0)
    return lambda image: [Sighting(tag.tag_id, tag.corners - 0.5) for tag in peer.detect(image)]


def scene(
    rng: np.random.Generator, condition: Condition, tags: int, size: tuple[int, int] = (800, 533)
) -> tuple[Image, list[Sighting]]:
    """Return an image of tags among quadrilaterals on a mottled ground, and where they are."""
    width, height = size
    ground = np.full((height, width), 105.0, np.float32)
    for grain, spread in ((2, 14.0), (6, 12.0), (30, 20.0), (120, 25.0)):
        speckle = rng.normal(0, spread, (height // grain + 2, width // grain + 2))
        ground += cv2.resize(speckle.astype(np.float32), size, interpolation=cv2.INTER_CUBIC)
    large = np.asarray(cv2.resize(np.clip(ground, 5, 250), None, fx=FINE, fy=FINE), np.float32)
    for _ in range(40):
        angles, radii = np.sort(rng.uniform(0, math.tau, 4)), rng.uniform(4, 30, 4)
        around = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        corners = (rng.uniform((0, 0), size) + around) * FINE
        cv2.fillPoly(large, [corners.astype(np.int32)], float(rng.uniform(15, 240)))
    truth = []
    centers: list[Array] = []
    apart = max(SEPARATION, 2 * condition.edges[1])
    for number in rng.choice(len(FAMILY.bytesList), tags, replace=False).tolist():
        for _ in range(300):
            center = rng.uniform((apart, apart), np.array(size) - apart)
            if all(np.linalg.norm(center - other) > apart for other in centers):
                centers.append(center)
                truth.append(Sighting(number, _draw(large, rng, number, center, condition)))
                break
    image = cv2.resize(large, size, interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), condition.blur)
    noisy = image + rng.normal(0, condition.noise, image.shape)
    return compressed(np.clip(noisy, 0, 255).astype(np.uint8), condition.jpeg), truth


def compressed(image: Image, quality: int) -> Image:
    """Return an image as JPEG shows it."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)


def _draw(
    large: NDArray[np.float32],
    rng: np.random.Generator,
    number: int,
    center: Array,
    condition: Condition,
) -> Array:
    """Draw a tag on paper with a margin of a module or two; return its (4, 2) corners, px."""
    turn, tilt = (_rotation(angle) for angle in rng.uniform(0, math.tau, 2))
    ratio = rng.uniform(condition.slant, 1)
    stretch = tilt @ np.diag([1, ratio]) @ turn / math.sqrt(ratio)
    to_image = np.eye(3)
    to_image[:2, :2] = stretch * rng.uniform(*condition.edges)
    to_image[2, :2] = rng.normal(0, 0.05, 2)  # perspective
    shift = np.eye(3)
    shift[:2, 2] = center
    to_image = shift @ to_image
    margin, dots = int(rng.integers(1, 3)), 16  # modules and pixels per module of the print
    bits = np.pad(
        cv2.aruco.generateImageMarker(FAMILY, number, MODULES) > 0,
        margin,
        "constant",
        constant_values=True,
    )
    paper = np.kron(np.where(bits, PAPER, INK) * rng.uniform(0.45, 1), np.ones((dots, dots)))
    to_unit = np.diag([1 / (MODULES * dots), 1 / (MODULES * dots), 1.0])
    to_unit[:2, 2] = 0.5 / (MODULES * dots) - 0.5 - margin / MODULES
    finer = np.diag([FINE, FINE, 1.0])
    finer[:2, 2] = (FINE - 1) / 2
    cv2.warpPerspective(
        paper.astype(np.float32),
        finer @ to_image @ to_unit,
        large.shape[::-1],
        dst=large,
        borderMode=cv2.BORDER_TRANSPARENT,
    )
    corners = np.column_stack([SQUARE, np.ones(4)]) @ to_image.T
    return np.asarray(corners[:, :2] / corners[:, 2:])


def _rotation(angle: float) -> Array:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
