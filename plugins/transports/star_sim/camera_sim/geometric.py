"""Detects tags without an image: their corners as a lens projects them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from star_core import Array, Camera, Mask, Pose, Rows, Tag, World
from star_core.toolkit import compiled, rotation_from_quaternion
from star_sim.camera_sim.camera_pose import Shot, mounting, optics
from star_sim.camera_sim.obstacle_rasterizer import Prisms, blocked
from star_sim.camera_sim.projection import project
from star_sim.camera_sim.tag_rasterizer import MAX_EMBEDDING, MODULES, corners, tag_frames
from star_sim.contact import prisms
from star_sim.drone import Record

BORDER = 3.0  # px, OpenCV's detector takes no corner that is nearer to the edge of the image
MIN_MODULE = 1.65  # px; of rendered tags with smaller modules, OpenCV finds fewer than half


class OnboardDetector:
    """A camera whose own processor detects tags, so that no image is needed.

    A tag is detected if it faces the camera, lies wholly in the image, is not partly hidden by an
    obstacle, and is not so far or so slanted that its modules are too small. Nearer tags hide
    nothing, and there are no random misses or false detections.

    Args:
        camera: The true one.
        tags: The true ones.
        world: For its obstacles.
        noise: Standard deviation of each corner in u and in v, px.
        min_module: Least width of a module, across the tag's longest side, px.
    """

    def __init__(
        self,
        camera: Camera,
        tags: Sequence[Tag],
        world: World,
        *,
        noise: float = 0.2,
        min_module: float = MIN_MODULE,
    ) -> None:
        self._optics, self._mount, self._prisms = optics(camera), mounting(camera), prisms(world)
        self._ids = np.array([tag.id for tag in tags], np.int64)
        frames = tag_frames(tags)
        self._centers, self._normals = frames[:, :3], frames[:, 9:12]
        self._corners = corners(frames)
        self._samples = _SAMPLES @ self._corners
        self._noise, self._min_module = noise, min_module

    def detect(self, shot: Shot, rng: np.random.Generator | None = None) -> tuple[Rows, Array]:
        """Return the tags that are detected.

        Args:
            shot: Pose and motion of the body.
            rng: Eight numbers are drawn from it for each tag detected; without it corners are
                exact.

        Returns:
            (K,) numbers of tags, in the order of the tags given; (K, 4, 2) px: bottom left, bottom
            right, top right and top left of the tag.
        """
        points = self._corners.reshape(-1, 3)
        flat = project(points, shot.packed(), self._mount, self._optics)
        pixels = flat.reshape(-1, 4, 2)
        body = Pose(rotation_from_quaternion(shot.attitude), shot.position)
        camera = body.apply(self._mount[9:])
        facing = ((camera - self._centers) * self._normals).sum(axis=1) > 0.0
        last = self._optics.width - 1 - BORDER, self._optics.height - 1 - BORDER
        within = ((pixels >= BORDER) & (pixels <= last)).all(axis=(1, 2))  # not so for NaN
        visible = np.flatnonzero(facing & within & (_module(pixels) >= self._min_module))
        if len(self._prisms[0]):
            visible = visible[~hidden(camera, self._samples[visible], self._prisms)]
        pixels = pixels[visible]
        if rng is not None:
            pixels += rng.normal(0.0, self._noise, pixels.shape)
        return self._ids[visible], pixels


def _module(pixels: Array) -> Array:
    """Return the width of modules across each tag's longest side, (M,) px."""
    sides = np.roll(pixels, -1, axis=1) - pixels
    longest = np.hypot(sides[..., 0], sides[..., 1]).max(axis=1)
    a, b = pixels[:, 2] - pixels[:, 0], pixels[:, 3] - pixels[:, 1]  # the diagonals
    width: Array = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / (longest * MODULES)
    return width


@compiled
def hidden(eye: Record, points: Record, prisms: Prisms) -> Mask:
    """Return which tags are partly hidden by a prism, (K,).

    Args:
        eye: (3,) in the map, m.
        points: (K, P, 3) of the tags in the map, m.
        prisms: Of `star_sim.contact.prisms`.
    """
    covered = np.zeros(len(points), np.bool_)
    for tag in range(len(points)):
        for k in range(points.shape[1]):
            point = (points[tag, k, 0], points[tag, k, 1], points[tag, k, 2])
            covered[tag] |= blocked((eye[0], eye[1], eye[2]), point, MAX_EMBEDDING, prisms)
    return covered


_U, _V = np.meshgrid([0.0, 0.5, 1.0], [0.0, 0.5, 1.0])  # shares of a tag's sides
_SAMPLES = np.stack([(1 - _U) * (1 - _V), _U * (1 - _V), _U * _V, (1 - _U) * _V], -1).reshape(9, 4)
