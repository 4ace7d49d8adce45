"""Takes pictures of the world: an image for each shot, by four kernels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from star_core import Camera, Image, Rows, Tag, World
from star_sim.camera_sim.floor_texture import Floor, draw_floor
from star_sim.camera_sim.motion import mounting, poses
from star_sim.camera_sim.obstacle_rasterizer import draw_prisms
from star_sim.camera_sim.optics import optics, rays
from star_sim.camera_sim.sensor import develop, spread, vignette
from star_sim.camera_sim.shot import Shot
from star_sim.camera_sim.tag_rasterizer import draw_tags
from star_sim.camera_sim.tag_tables import CELLS, MODULES, corners, frames, prints
from star_sim.contact import prisms

LEAST_SLICES, MOST_SLICES = 3, 15  # into which an exposure is divided
SLICE = 2.0  # px that things may move in the image during one slice
BLURRED = 1.0  # px; the floor is drawn once, not in slices, if it moves less during an exposure
LOW = 0.1  # m; below, things do not get any faster


class Renderer:
    """A camera with which pictures of a world are taken.

    Modelled are the lens with its distortion, the blur of what moves, rows that are exposed one
    after the other, the spread of light, its falling off outwards, and noise. Tags may lie on any
    plane; their backs are not seen; obstacles and nearer tags hide them. Other drones, shadows,
    reflections and changes of exposure are not modelled, and obstacles are drawn unblurred.

    Args:
        camera: As it really is; see `star_sim.camera_sim.ground_truth`.
        tags: As they really are.
        world: For its obstacles; its own tags are not drawn.
        floor: Of `star_sim.camera_sim.floor_texture.floor`.
        noise: Deviation of the noise of reading out, grey values of 255.
        shot_noise: Variance of the noise of light, grey values² for each grey value of it.
        blur: Deviation of the lens's spread of light, px.
    """

    def __init__(
        self,
        camera: Camera,
        tags: Sequence[Tag],
        world: World,
        floor: Floor,
        *,
        noise: float = 4.0,
        shot_noise: float = 0.0,
        blur: float = 0.7,
    ) -> None:
        self._optics, self._mount = optics(camera), mounting(camera)
        self._rays = rays(camera)
        x, y = self._rays
        self._field = (float(x.min()), float(y.min()), float(x.max()), float(y.max()))
        places = frames(tags)
        self._tags = (places, corners(places, CELLS / MODULES), prints(tags))
        self._prisms = prisms(world)
        self._floor = floor
        self._spread, self._vignette = spread(blur), vignette(camera)
        self._noise, self._shot_noise = noise, shot_noise

    def render(self, shot: Shot, rng: np.random.Generator, printed: Rows | None = None) -> Image:
        """Return the (height, width) image of a shot.

        Args:
            shot: Where the body is.
            rng: Noise takes one number from it.
            printed: (M,) rows of the tags whose patterns the tags bear; None for their own.
        """
        lens, rays_ = self._optics, self._rays
        moved = self._moved(shot)
        slices = min(max(LEAST_SLICES, 2 * math.ceil(moved / SLICE / 2) + 1), MOST_SLICES)
        track = poses(shot.packed(), self._mount, lens, slices)
        shape = rays_.shape[1:]
        light, gap = np.zeros(shape, np.float32), np.ones(shape, np.float32)
        depth, shade = np.full(shape, np.inf, np.float32), np.zeros(shape, np.float32)
        if len(self._prisms[0]):
            draw_prisms(depth, shade, rays_, track, lens, self._field, *self._prisms)
        if len(self._tags[0]):
            places, rims, patterns = self._tags
            patterns = patterns if printed is None else patterns[printed]
            draw_tags(light, gap, depth, rays_, track, lens, self._field, places, rims, patterns)
        draw_floor(light, gap, depth, shade, rays_, track, lens, *self._floor, moved > BLURRED)
        key = int(rng.integers(2**32))
        return develop(light, self._spread, self._vignette, self._noise, self._shot_noise, key)

    def _moved(self, shot: Shot) -> float:
        """Return about how far the floor moves in the image during an exposure, px."""
        speed = np.linalg.norm(shot.velocity) / max(float(shot.position[2]), LOW)
        pixels = self._optics.exposure * self._optics.fx
        return float(pixels * (speed + np.linalg.norm(shot.rates)))
