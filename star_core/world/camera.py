"""A camera that an agent carries. Nothing here imports numpy."""

from __future__ import annotations

import math
from dataclasses import dataclass

from star_core.world.quaternions import Point, Quaternion, product, turned

FORWARD: Quaternion = (-0.5, 0.5, -0.5, 0.5)
"""From a camera's frame to the body's, for a camera that looks straight ahead, the right way up."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera with OpenCV's pinhole model. The defaults are an AI-deck's, pitched down.

    Its frame has x to the right of the image, y down, z ahead; the middle of the first pixel is at
    (0, 0). The intrinsics are those that the original STAR's users calibrated.

    Attributes:
        width: px.
        height: px.
        matrix: Focal lengths and principal point fx, fy, cx, cy, px.
        distortion: k1, k2, p1, p2, k3.
        position: In the body frame, m.
        roll: Of its mounting in the body, rad, in the order roll, pitch, yaw; with zeros it looks
            along the body's x axis, upright.
        pitch: rad, down positive (right-handed about y).
        yaw: rad.
        rate: Of images, Hz.
        exposure: Of each row of pixels, s.
        readout: Time from the readout of the first row to that of the last, s; rows are exposed
            one after the other.
        pixels: ``gray``, or the colors of a Bayer mosaic's first two pixels and of those below
            them, as ``bayer_rggb``. The core makes its images gray (`gray_from_mosaic`).
    """

    width: int = 324
    height: int = 244
    matrix: tuple[float, float, float, float] = (180.05, 180.53, 169.27, 160.60)
    distortion: tuple[float, float, float, float, float] = (-0.077, -0.0068, 0.0008, 0.0007, 0.0)
    position: Point = (0.025, 0.0, 0.015)
    roll: float = 0.0
    pitch: float = math.radians(45.0)
    yaw: float = 0.0
    rate: float = 10.0
    exposure: float = 0.01
    readout: float = 0.03
    pixels: str = "gray"

    @property
    def rotation(self) -> Quaternion:
        """From the camera's frame to the body's.

        >>> [round(abs(value), 3) for value in Camera(pitch=0.0).rotation]
        [0.5, 0.5, 0.5, 0.5]
        """
        return product(turned(self.roll, self.pitch, self.yaw), FORWARD)
