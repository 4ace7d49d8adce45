"""How a lens maps directions to pixels: OpenCV's pinhole model, there and back.

The middle of the first pixel is at (0, 0), so an image reaches from -0.5 to width - 0.5.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from star_core import Array, Camera
from star_sim.compiled import compiled, kernel

BEYOND = 1.1  # how far out, as a multiple of the farthest pixel's direction, anything is looked for
WIDEST = 10.0  # tangent of the angle off the axis, 84°
LEAST_SLOPE = (
    0.25  # of the radius in the image over that of the direction: else the model turns back
)
CONVERGED = 1e-12
ITERATIONS = 20  # of the inversion: Newton's for the radius, and the tilt of the lens beside it


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

    A polynomial that was fitted to the middle of the image can turn back before its corners: then
    no direction is seen there. The model is trusted up to where it flattens out; pixels beyond see
    what the last ones before them see.
    """
    numbers = [
        float(value)
        for value in (
            camera.width,
            camera.height,
            *camera.matrix,
            *camera.distortion,
            camera.exposure,
            camera.readout,
        )
    ]
    k1, k2, _, _, k3 = camera.distortion
    radius = np.linspace(0.0, WIDEST, 10_000)
    slope = 1 + 3 * k1 * radius**2 + 5 * k2 * radius**4 + 7 * k3 * radius**6
    flat = float(radius[slope < LEAST_SLOPE].min(initial=WIDEST))
    farthest = np.hypot(*rays(Optics._make([*numbers, flat]))).max()
    return Optics._make([*numbers, min(flat, BEYOND * float(farthest))])


@kernel
def rays(lens: Optics) -> Array:
    """Return the directions that pixels look in.

    Returns:
        (2, height, width) x and y of the direction (x, y, 1), camera frame.
    """
    table = np.empty((2, int(lens.height), int(lens.width)))
    for v in range(table.shape[1]):
        for u in range(table.shape[2]):
            table[0, v, u], table[1, v, u] = _direction(lens, u, v)
    return table


@compiled
def pixel(lens: Optics, x: float, y: float) -> tuple[float, float]:
    """Return the pixel u, v at which the direction (x, y, 1) of the camera's frame is seen.

    The model is OpenCV's: radial k1, k2, k3, tangential p1, p2.
    """
    square = x * x + y * y
    radial = 1.0 + square * (lens.k1 + square * (lens.k2 + square * lens.k3))
    across = radial * x + 2.0 * lens.p1 * x * y + lens.p2 * (square + 2.0 * x * x)
    down = radial * y + lens.p1 * (square + 2.0 * y * y) + 2.0 * lens.p2 * x * y
    return lens.fx * across + lens.cx, lens.fy * down + lens.cy


@compiled
def _direction(lens: Optics, u: float, v: float) -> tuple[float, float]:
    """Return x, y of the direction (x, y, 1) that is seen at a pixel: `pixel` undone."""
    across, down = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    x, y = across, down
    radius = min(math.hypot(across, down), lens.reach)
    for _ in range(ITERATIONS):
        square = x * x + y * y
        one = across - 2.0 * lens.p1 * x * y - lens.p2 * (square + 2.0 * x * x)
        two = down - lens.p1 * (square + 2.0 * y * y) - 2.0 * lens.p2 * x * y
        wanted = math.hypot(one, two)
        if wanted == 0.0:
            return 0.0, 0.0
        square = radius * radius
        image = radius * (1.0 + square * (lens.k1 + square * (lens.k2 + square * lens.k3)))
        slope = square * (3.0 * lens.k1 + square * (5.0 * lens.k2 + square * 7.0 * lens.k3))
        slope = max(1.0 + slope, LEAST_SLOPE)
        radius = min(max(radius - (image - wanted) / slope, 0.0), lens.reach)
        before_x, before_y = x, y
        x, y = one / wanted * radius, two / wanted * radius
        if abs(x - before_x) + abs(y - before_y) < CONVERGED:
            break
    return x, y
