"""Disturbances of images: exposure, fixed patterns, lamps, clutter, JPEG and vibration.

All are off by default. Each draws from streams of its own, so that one does not change another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from star_core import Array, Camera, Fence, Image, Tag
from star_sim.camera_sim.camera_pose import Shot
from star_sim.camera_sim.options import CameraOptions
from star_sim.camera_sim.tag_rasterizer import CELLS, INK, PAPER

EXPOSURE_IMAGES: Final = 10  # images between two steps of the exposure
VIBRATION_FREQUENCY: Final = 15.0  # Hz, assumed
LAMP: Final = 1000.0  # gray values of a lamp's reflection; blur spreads what is beyond white
LAMP_SIZE, CLUTTER_SIZE = (0.03, 0.12), (0.08, 0.2)  # m, least and greatest edge
_PLACES, _SENSOR, _IMAGES = 7344, 7345, 7346  # streams


def lamps_and_clutter(fence: Fence, seed: int, lamps: int, clutter: int) -> tuple[list[Tag], Array]:
    """Return squares on the floor of a fence, and their prints, (M, CELLS, CELLS) gray values.

    Reflections of lamps are saturated; clutter has the paper and the black border of a tag around
    a random pattern, which may not be a code.
    """
    rng = np.random.default_rng([seed, _PLACES])
    squares, prints = [], np.full((lamps + clutter, CELLS, CELLS), LAMP)
    for k in range(lamps + clutter):
        x, y = rng.uniform(fence.low[:2], fence.high[:2])
        size = rng.uniform(*(LAMP_SIZE if k < lamps else CLUTTER_SIZE))
        half = rng.uniform(-math.pi, math.pi) / 2
        turn = (0.0, 0.0, math.sin(half), math.cos(half))
        squares.append(Tag(0, size, (float(x), float(y), 0.0), turn, "clutter"))
        if k >= lamps:
            prints[k] = PAPER
            prints[k, 1:-1, 1:-1] = INK
            prints[k, 2:-2, 2:-2] = rng.choice([INK, PAPER], (CELLS - 4, CELLS - 4))
    return squares, prints


class Disturbances:
    """Disturbs the images of one camera, in the order in which they are taken."""

    def __init__(self, camera: Camera, seed: Sequence[int], options: CameraOptions) -> None:
        self._step, self._quality = options.exposure_step, options.jpeg_quality
        self._vibration = math.radians(options.vibration_std_deg)
        rng = np.random.default_rng([*seed, _SENSOR])
        columns = rng.standard_normal(camera.width)
        pixels = rng.standard_normal((camera.height, camera.width))
        self._offset = options.fixed_pattern_std * (columns + pixels)
        self._noisy = options.fixed_pattern_std > 0
        self._rng = np.random.default_rng([*seed, _IMAGES])
        self._taken, self._gain = 0, 1.0

    def shaken(self, shot: Shot) -> Shot:
        """Return a shot from a body that vibrates about all axes."""
        angles, rates = self._rng.standard_normal((2, 3)) * self._vibration
        if not self._vibration:
            return shot
        ax, ay, az = (angles / 2).tolist()
        x, y, z, w = shot.attitude.tolist()
        turned = [
            x + w * ax + y * az - z * ay,
            y + w * ay - x * az + z * ax,
            z + w * az + x * ay - y * ax,
            w - x * ax - y * ay - z * az,
        ]
        moving = shot.rates + 2 * math.pi * VIBRATION_FREQUENCY * rates
        attitude = np.array(turned) / np.linalg.norm(turned)
        return shot._replace(attitude=attitude, rates=moving)

    def disturbed(self, image: Image) -> Image:
        """Return an image as this camera would have taken it."""
        if self._taken % EXPOSURE_IMAGES == 0:
            self._gain = 1.0 + self._step * self._rng.uniform(-1, 1)
        self._taken += 1
        if self._step or self._noisy:
            gray = image * self._gain + self._offset
            image = np.asarray(np.clip(np.rint(gray), 0, 255), np.uint8)
        if self._quality:
            _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self._quality])
            image = np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)
        return image
