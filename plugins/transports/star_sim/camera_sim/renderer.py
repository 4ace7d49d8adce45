"""Renders images of the world, by four kernels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from star_core import Array, Camera, Image, Rows, Tag, World
from star_sim.camera_sim.camera_pose import Canvas, Exposure, Shot, mounting, optics, poses, rays
from star_sim.camera_sim.floor_texture import GROUND, Floor, draw_floor
from star_sim.camera_sim.obstacle_rasterizer import draw_prisms, faces
from star_sim.camera_sim.sensor import color_response, develop, spread, vignette
from star_sim.camera_sim.tag_rasterizer import (
    CELLS,
    MODULES,
    TagTables,
    corners,
    draw_tags,
    prints,
    tag_frames,
)
from star_sim.contact import prisms

MIN_SLICES, MAX_SLICES = 3, 15  # of an exposure
SLICE_MOTION = 2.0  # px of motion in the image during one slice
MIN_BLUR = 1.0  # px of motion during an exposure from which on the floor is drawn in slices
MIN_HEIGHT = 0.1  # m, below which motion in the image is not faster


class Renderer:
    """A camera that renders images of a world.

    Modeled are the lens with its distortion, motion blur, rolling shutter, the lens's blur and
    vignetting, and noise. Tags may lie on any plane; their backs are not visible; obstacles and
    nearer tags hide them. Other drones and shadows are not modeled, and obstacles have
    no motion blur; `star_sim.camera_sim.disturbances` changes images afterwards.

    Args:
        camera: The true one; see `star_sim.camera_sim.ground_truth`.
        tags: The true ones.
        world: For its obstacles; its own tags are not drawn.
        floor: Of `star_sim.camera_sim.floor_texture.floor`.
        others: Other squares, and their (M, CELLS, CELLS) gray values with a margin of a module.
        noise: Standard deviation of the readout noise, gray values of 255.
        blur: Standard deviation of the lens's blur, px.
    """

    def __init__(
        self,
        camera: Camera,
        tags: Sequence[Tag],
        world: World,
        floor: Floor,
        others: tuple[Sequence[Tag], Array] = ((), np.empty((0, CELLS, CELLS))),
        *,
        noise: float = 4.0,
        blur: float = 0.7,
    ) -> None:
        self._optics, self._mount = optics(camera), mounting(camera)
        self._rays = rays(camera)
        x, y = self._rays
        self._field = (float(x.min()), float(y.min()), float(x.max()), float(y.max()))
        squares, patterns = others
        frames = tag_frames([*tags, *squares])
        patterns = np.concatenate([prints(tags), patterns])
        self._tags = TagTables(frames, corners(frames, CELLS / MODULES), patterns)
        self._prisms = prisms(world)
        self._faces = faces(self._prisms[0])
        self._floor = floor
        self._spread = spread(blur)
        self._vignette = vignette(camera) * color_response(camera)
        self._noise = noise

    def render(self, shot: Shot, rng: np.random.Generator, printed: Rows | None = None) -> Image:
        """Return the (height, width) image of a shot; of a color camera, its mosaic.

        Args:
            shot: Pose and motion of the body.
            rng: One number is drawn from it, for the noise.
            printed: (M,) rows of the tags whose patterns the tags have; None for their own.
        """
        moved = self._moved(shot)
        slices = min(max(MIN_SLICES, 2 * math.ceil(moved / SLICE_MOTION / 2) + 1), MAX_SLICES)
        track = poses(shot.packed(), self._mount, self._optics, slices)
        exposure = Exposure(self._rays, track, self._optics, self._field)
        shape = self._rays.shape[1:]
        canvas = Canvas(
            light=np.zeros(shape, np.float32),
            gap=np.ones(shape, np.float32),
            depth=np.full(shape, np.inf, np.float32),
            shade=np.zeros(shape, np.float32),
        )
        if len(self._faces):
            draw_prisms(canvas, exposure, self._faces, self._prisms)
        if len(self._tags.frames):
            tags = self._tags
            if printed is not None:
                rows = np.append(printed, np.arange(len(printed), len(tags.prints)))
                tags = tags._replace(prints=tags.prints[rows])
            draw_tags(canvas, exposure, tags)
        draw_floor(canvas, exposure, self._floor, GROUND, slices if moved > MIN_BLUR else 1)
        key = int(rng.integers(2**32))
        return develop(canvas.light, self._spread, self._vignette, self._noise, key)

    def _moved(self, shot: Shot) -> float:
        """Return about how far the floor moves in the image during an exposure, px."""
        height = max(float(shot.position[2]), MIN_HEIGHT)
        rate = np.linalg.norm(shot.velocity) / height + np.linalg.norm(shot.rates)
        return float(self._optics.exposure * self._optics.fx * rate)
