"""Where pixels point: the inverse of a camera's pinhole model with its distortion."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core import Array, Camera

ROUNDS: Final = 20
"""Of the fixed point: nearly all over the image of an AI-deck it is then within 0.001 px."""

SETTLED: Final = 1e-4  # of a ray: one that still moves so far in a round is none


def rays(pixels: Array, camera: Camera) -> Array:
    """Return the directions that pixels look in, as x / z and y / z in the camera's frame.

    The lens is that of Brown, "Decentering distortion of lenses" (Photogrammetric Engineering 32,
    1966), with the coefficients k1, k2, p1, p2, k3 of OpenCV. It has no inverse in closed form;
    what it adds at the last guess is taken off, over and over.

    Args:
        pixels: (K, 2) px, as the lens shows them.
        camera: Whose they are.

    Returns:
        (K, 2); NaN where the lens shows nothing, or the guesses do not settle.

    Example:
        >>> rays(np.array([[259.3, 180.1]]), Camera()).round(2)
        array([[0.51, 0.11]])
    """
    fx, fy, cx, cy = camera.matrix
    k1, k2, p1, p2, k3 = camera.distortion
    bent = (pixels - [cx, cy]) / [fx, fy]
    found = last = bent
    with np.errstate(all="ignore"):  # guesses that run away are none
        for _ in range(ROUNDS):
            x, y = found.T
            square = x * x + y * y
            radial = 1 + square * (k1 + square * (k2 + square * k3))
            aside = np.stack(
                [
                    2 * p1 * x * y + p2 * (square + 2 * x * x),
                    p1 * (square + 2 * y * y) + 2 * p2 * x * y,
                ],
                axis=1,
            )
            last, found = found, (bent - aside) / radial[:, None]
        settled = np.abs(found - last).max(axis=1, keepdims=True) <= SETTLED
    return np.where(settled, found, np.nan)
