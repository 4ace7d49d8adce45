"""The floor under the tags: a tiled, stained texture, looked up once per pixel and slice."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from star_core import Rows
from star_sim.camera_sim.optics import Optics
from star_sim.camera_sim.plane import onto
from star_sim.compiled import Record, compiled, kernel

TEXEL = 0.0025  # m
SIDE = 1024  # texels, a power of two: the floor repeats after 2.56 m
TILE = 128  # texels: tiles of 0.32 m
JOINT = 2  # texels, the width of the joints between them
GREY, STAINS, TILES, DARK = 115.0, 9.0, 5.0, 35.0  # mean; deviations of stains and of tiles; joints
ROUGHNESS = 0.8  # the amplitude of stains falls with this power of their spatial frequency
BACKGROUND = 140.0  # grey value above the horizon
AHEAD = 2.0**22 - 0.5  # texels: a multiple of SIDE, so that none is negative; and half a texel
FARTHEST = 1000.0  # m; beyond, the floor is plain
_STREAM = 0xF1003  # keeps the texture's random numbers apart from others of the same seed

GROUND = np.array([0.0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1])  # the map's own frame, for `onto`


class Floor(NamedTuple):
    """A texture at every scale: each level has half as many texels along a side as the one before.

    Attributes:
        texels: Grey values of all levels, one after the other, row by row.
        starts: (L,) where each level begins.
    """

    texels: NDArray[np.uint8]
    starts: Rows


def floor(seed: int) -> Floor:
    """Return the floor of a seed. It can serve any number of cameras."""
    rng = np.random.default_rng([seed, _STREAM])
    frequency = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.fft.rfftfreq(SIDE))
    frequency[0, 0] = np.inf
    stains = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((SIDE, SIDE))) / frequency**ROUGHNESS)
    tiles = rng.normal(0.0, TILES, (SIDE // TILE, SIDE // TILE))
    texture = GREY + STAINS * stains / stains.std() + np.kron(tiles, np.ones((TILE, TILE)))
    joint = np.arange(SIDE) % TILE < JOINT
    texture -= DARK * (joint[:, None] | joint)
    levels = [texture]
    while len(levels[-1]) > 1:
        finer = levels[-1]
        levels.append(finer.reshape(len(finer) // 2, 2, -1, 2).mean(axis=(1, 3)))
    sizes = [level.size for level in levels]
    return Floor(
        np.concatenate([level.ravel() for level in levels]).clip(0, 255).round().astype(np.uint8),
        np.cumsum([0, *sizes[:-1]]),
    )


@kernel
def draw_floor(  # noqa: PLR0913, PLR0917 -- a kernel takes all it needs
    light: Record,
    gap: Record,
    depth: Record,
    shade: Record,
    rays: Record,
    poses: Record,
    lens: Optics,
    texels: Record,
    starts: Record,
    blurred: bool,  # noqa: FBT001 -- a kernel's arguments have no names
) -> None:
    """Fill what is not covered yet: with obstacles, the floor, or what is above the horizon.

    A pixel looks at the level whose texels are about as large as its own area on the floor, which
    is ``depth³ / height`` times its solid angle at the middle of the image, between texels
    linearly.

    Args:
        light: (H, W) grey values; added to.
        gap: (H, W) share of each pixel that is not covered.
        depth: (H, W) how far along each ray an obstacle stands, m.
        shade: (H, W) grey values of obstacles.
        rays: (2, H, W) directions of pixels.
        poses: (H, S, 12) of the camera.
        lens: The camera.
        texels: Of `Floor`.
        starts: Of `Floor`.
        blurred: Whether it is worth the time to look at the floor once for each slice.
    """
    slices = poses.shape[1]
    height = max(poses[poses.shape[0] // 2, slices // 2, 11], TEXEL)
    limits = np.empty(len(starts))
    for level in range(len(limits)):  # at this depth the next level begins to serve
        limits[level] = (height * lens.fx * lens.fy * TEXEL**2 * 2.0 * 4.0**level) ** (1 / 3)
    limits[-1] = math.inf
    first, end = 0, slices
    if not blurred:
        first, end = slices // 2, slices // 2 + 1
    width = light.shape[1]
    total, reach = np.empty(width), np.empty(width)
    across, down = np.empty(width), np.empty(width)
    map_ = np.empty(9)
    for v in range(light.shape[0]):
        total[:] = 0.0
        for k in range(first, end):
            away = onto(poses[v, k], GROUND, TEXEL, 0.0, map_)
            _meet(rays[0, v], rays[1, v], map_, away, across, down, reach)
            _look(across, down, reach, texels, starts, limits, total)
        for u in range(width):
            grey = total[u] / (end - first) if reach[u] > 0.0 else BACKGROUND
            light[v, u] += gap[v, u] * (grey if depth[v, u] == math.inf else shade[v, u])


@compiled
def _meet(
    xs: Record, ys: Record, map_: Record, away: float, across: Record, down: Record, reach: Record
) -> None:
    """Find where the pixels of one row meet the floor.

    This loop has neither branches nor look-ups, for the compiler to do several pixels at once.

    Args:
        xs: (W,) of directions.
        ys: (W,) of directions.
        map_: (9,) homography from directions to texels.
        away: m, of `onto`.
        across: (W,) filled with texels along x.
        down: (W,) filled with texels against y.
        reach: (W,) filled with depths, m; not above 0 over the horizon.
    """
    a, b, c = map_[0], map_[1], map_[2]
    d, e, f = map_[3], map_[4], map_[5]
    g, h, i = map_[6], map_[7], map_[8]
    for u in range(len(xs)):
        x, y = xs[u], ys[u]
        w = 1.0 / (g * x + h * y + i)
        across[u] = (a * x + b * y + c) * w
        down[u] = (d * x + e * y + f) * w
        reach[u] = away * w


@compiled
def _look(
    across: Record,
    down: Record,
    reach: Record,
    texels: Record,
    starts: Record,
    limits: Record,
    total: Record,
) -> None:
    """Add to `total` what the pixels of one row see of the floor.

    Indices are unsigned, which spares the test whether they count from the end.

    Args:
        across: (W,) texels along x.
        down: (W,) texels against y.
        reach: (W,) depths, m.
        texels: Of `Floor`.
        starts: Of `Floor`.
        limits: (L,) depth at which each level ends, m.
        total: (W,) grey values, added to.
    """
    level, scale, last, start = 0, 1.0, np.uint32(SIDE - 1), np.uint64(starts[0])
    one, shift = np.uint32(1), np.uint32(0)
    for u in range(len(across)):
        far = reach[u]
        if not 0.0 < far < FARTHEST:
            total[u] += GREY
            continue
        if far > limits[level] or (level > 0 and far <= limits[level - 1]):
            while far > limits[level]:
                level += 1
            while level > 0 and far <= limits[level - 1]:
                level -= 1
            scale, shift = 0.5**level, np.uint32(level)
            last, start = np.uint32((SIDE >> level) - 1), np.uint64(starts[level])
        s, t = across[u] * scale + AHEAD, down[u] * scale + AHEAD
        column, row = np.uint32(s), np.uint32(t)
        right, under = s - column, t - row
        upper = start + np.uint64((row & last) * (np.uint32(SIDE) >> shift))
        lower = start + np.uint64(((row + one) & last) * (np.uint32(SIDE) >> shift))
        west, east = np.uint64(column & last), np.uint64((column + one) & last)
        a, b = float(texels[upper + west]), float(texels[upper + east])
        c, d = float(texels[lower + west]), float(texels[lower + east])
        a += right * (b - a)
        c += right * (d - c)
        total[u] += a + under * (c - a)
