"""From light to gray values: blur and vignetting of the lens, and noise of the sensor."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from star_core import Camera, Image
from star_core.toolkit import compiled, subroutine
from star_sim.drone import Record

VIGNETTING = 0.3  # of the light that is lost at the corner farthest from the axis

COLOR_RESPONSE = {"r": 0.62, "g": 1.0, "b": 0.52}
"""Of a color sensor's pixels to the light of white paper, over that of the green ones; assumed: a
raw mosaic has no white balance."""

# A standard normal number is approximated, up to 3.45 deviations, by the sum of the four uniform
# bytes of a random one, with this mean and scale.
BYTES_MEAN = np.float32(4 * 255 / 2)
BYTES_SCALE = np.float32(1 / math.sqrt(4 * (256**2 - 1) / 12))
GOLDEN = np.uint32(0x9E3779B9)  # 2³² over the golden ratio, which separates neighbors


def spread(deviation: float) -> NDArray[np.float32]:
    """Return the weights of a truncated Gaussian blur with a standard deviation in px."""
    radius = math.ceil(3 * deviation - 0.5) if deviation > 0 else 0
    away = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 * (away / deviation) ** 2) if radius else np.ones(1)
    return np.asarray(weights / weights.sum(), np.float32)


def vignette(camera: Camera) -> NDArray[np.float32]:
    """Return the share of light at each pixel, (height, width)."""
    fx, fy, cx, cy = camera.matrix
    x, y = (np.arange(camera.width) - cx) / fx, (np.arange(camera.height) - cy) / fy
    square = x**2 + y[:, None] ** 2
    return np.asarray(1 - VIGNETTING * square / square.max(), np.float32)


def color_response(camera: Camera) -> NDArray[np.float32]:
    """Return how much of white light each pixel responds to, (height, width)."""
    shape = camera.height, camera.width
    if camera.pixels == "gray":
        return np.ones(shape, np.float32)
    kinds = [COLOR_RESPONSE[color] for color in camera.pixels.removeprefix("bayer_")]
    rows, columns = np.indices(shape) % 2
    return np.asarray(np.array(kinds, np.float32)[2 * rows + columns])


@compiled
def develop(light: Record, weights: Record, share: Record, read: float, key: int) -> Image:
    """Return the sensor's image.

    Each step is a loop of its own over a row, so that the compiler can vectorize it.

    Args:
        light: (H, W) float32 gray values.
        weights: (2 R + 1,) of `spread`.
        share: (H, W) of `vignette`.
        read: Standard deviation of the readout noise, gray values.
        key: Seed of the noise, less than 2³².
    """
    height, width = light.shape
    radius = len(weights) // 2
    image = np.empty((height, width), np.uint8)
    padded = np.empty(width + 2 * radius, np.float32)
    row, normal = np.empty(width, np.float32), np.zeros(width, np.float32)
    deviation, half = np.sqrt(np.float32(read * read)), np.float32(0.5)
    black, white = np.float32(0.0), np.float32(255.0)
    for v in range(height):
        padded[:] = black
        for k in range(len(weights)):
            weight, source = weights[k], light[min(max(v + k - radius, 0), height - 1)]
            for u in range(width):
                padded[radius + u] += weight * source[u]
        for k in range(radius):
            padded[k], padded[radius + width + k] = padded[radius], padded[radius + width - 1]
        row[:] = black
        for k in range(len(weights)):
            weight, source = weights[k], padded[k:]
            for u in range(width):
                row[u] += weight * source[u]
        if read > 0.0:
            _normals(_mixed(np.uint32(np.uint32(key) + np.uint32(v) * GOLDEN)), normal)
        passed, shown = share[v], image[v]
        for u in range(width):
            gray = row[u] * passed[u]
            gray += deviation * normal[u]
            row[u] = min(max(gray + half, black), white)
        for u in range(width):
            shown[u] = np.uint8(np.int32(row[u]))
    return image


@subroutine
def _normals(start: np.uint32, normal: Record) -> None:
    """Fill an array with float32 numbers that look standard normal, derived from `start`."""
    byte = np.uint32(255)
    for u in range(len(normal)):
        bits = _mixed(np.uint32(start + np.uint32(u) * GOLDEN))
        total = np.int32(bits & byte) + np.int32((bits >> np.uint32(8)) & byte)
        total += np.int32((bits >> np.uint32(16)) & byte) + np.int32(bits >> np.uint32(24))
        normal[u] = (np.float32(total) - BYTES_MEAN) * BYTES_SCALE


@subroutine
def _mixed(x: np.uint32) -> np.uint32:
    """Return 32 bits that look random, derived from `x`: the finalizer of MurmurHash3."""
    x ^= x >> np.uint32(16)
    x = np.uint32(x * np.uint32(0x85EBCA6B))
    x ^= x >> np.uint32(13)
    x = np.uint32(x * np.uint32(0xC2B2AE35))
    x ^= x >> np.uint32(16)
    return np.uint32(x)
