"""How a lens maps directions to pixels: OpenCV's pinhole model, there and back.

The middle of the first pixel is at (0, 0), so an image reaches from -0.5 to width - 0.5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from star_core import Array, Camera, CameraModel, distort
from star_sim.compiled import compiled

BEYOND = 1.1  # how far out, as a multiple of the farthest pixel's direction, anything is looked for


class Optics(NamedTuple):
    """A camera's numbers as kernels take them: all floats; see `Camera` for the units.

    Attributes:
        width: px.
        height: px.
        fx: px.
        fy: px.
        cx: px.
        cy: px.
        k1: Of r², as k2 and k3 are of its powers.
        k2: Of r to the fourth power.
        p1: Of the tilt of the lens.
        p2: Of the tilt of the lens.
        k3: Of r to the sixth power.
        exposure: s.
        readout: s.
        reach: Greatest tangent of the angle off the axis at which the model is trusted.
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

    A direction farther off the axis than the model reaches is not seen; pixels beyond see what the
    last ones before them see.
    """
    farthest = float(np.hypot(*rays(camera)).max())
    return Optics._make(
        float(value)
        for value in (
            camera.width,
            camera.height,
            *camera.matrix,
            *camera.distortion,
            camera.exposure,
            camera.readout,
            min(CameraModel(camera).reach, BEYOND * farthest),
        )
    )


def rays(camera: Camera) -> Array:
    """Return the directions that pixels look in.

    Returns:
        (2, height, width) x and y of the direction (x, y, 1), camera frame.
    """
    v, u = np.indices((camera.height, camera.width))
    table = CameraModel(camera).undistort(np.stack([u, v], axis=-1), clip=True)
    return np.ascontiguousarray(np.moveaxis(table, -1, 0))


@compiled
def pixel(lens: Optics, x: float, y: float) -> tuple[float, float]:
    """Return the pixel u, v at which the direction (x, y, 1) of the camera's frame is seen."""
    across, down = _distort(x, y, lens.k1, lens.k2, lens.p1, lens.p2, lens.k3)
    return lens.fx * across + lens.cx, lens.fy * down + lens.cy


_distort = compiled(distort)
