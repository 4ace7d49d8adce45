"""A camera's lens for kernels: OpenCV's pinhole model, from directions to pixels and back.

The middle of the first pixel is at (0, 0), so an image reaches from -0.5 to width - 0.5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from star_core import Array, Camera, CameraModel, distort
from star_sim.compiled import compiled

FIELD_MARGIN = 1.1  # of the farthest pixel's direction, up to which directions are projected


class Optics(NamedTuple):
    """A camera's numbers for kernels, all floats; see `Camera` for their units.

    `reach` is the greatest tangent of the angle off the axis at which the model is used.
    """

    width: float
    height: float
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    exposure: float
    readout: float
    reach: float


def optics(camera: Camera) -> Optics:
    """Return a camera's numbers for the kernels.

    A direction beyond the model's reach is not seen; pixels beyond it see what the last ones within
    it see.
    """
    farthest = float(np.hypot(*rays(camera)).max())
    reach = min(CameraModel(camera).reach, FIELD_MARGIN * farthest)
    size = camera.width, camera.height
    times = camera.exposure, camera.readout
    return Optics._make(map(float, (*size, *camera.matrix, *camera.distortion, *times, reach)))


def rays(camera: Camera) -> Array:
    """Return (2, height, width): x and y of the pixels' directions (x, y, 1), camera frame."""
    v, u = np.indices((camera.height, camera.width))
    table = CameraModel(camera).undistort(np.stack([u, v], axis=-1), clip=True)
    return np.ascontiguousarray(np.moveaxis(table, -1, 0))


@compiled
def pixel(lens: Optics, x: float, y: float) -> tuple[float, float]:
    """Return the pixel u, v of the direction (x, y, 1) in the camera's frame."""
    across, down = _distort(x, y, lens.k1, lens.k2, lens.p1, lens.p2, lens.k3)
    return lens.fx * across + lens.cx, lens.fy * down + lens.cy


_distort = compiled(distort)
