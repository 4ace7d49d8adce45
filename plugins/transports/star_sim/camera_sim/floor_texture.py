"""Draws the floor: a tiled, stained texture with a level for every scale."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from star_core import Rows
from star_core.toolkit import compiled, subroutine
from star_sim.camera_sim.camera_pose import Canvas, Exposure
from star_sim.camera_sim.projection import plane_homography
from star_sim.drone import Record

TEXEL = 0.0025  # m
SIDE = 1024  # texels, a power of two: the floor repeats after 2.56 m
TILE = 128  # texels: tiles of 0.32 m
JOINT = 2  # texels, width of the joints between tiles
GRAY, JOINT_CONTRAST = 115.0, 35.0  # gray values: mean; by how much joints are darker
STAIN_STD, TILE_STD = 9.0, 5.0  # gray values
ROUGHNESS = 0.8  # power of the spatial frequency with which the amplitude of stains falls
BACKGROUND = 140.0  # gray value above the horizon
OFFSET = 2.0**22 - 0.5  # texels: a multiple of SIDE, against negative indices, and half a texel
MAX_DEPTH = 1000.0  # m, beyond which the floor is plain
_STREAM = 0xF1003  # separates the texture's random stream from others of the same seed

GROUND = np.array([0.0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1])  # the map's frame as a plane


class Floor(NamedTuple):
    """A mipmap: each level has half as many texels along a side as the one before."""

    texels: NDArray[np.uint8]  # gray values of all levels, one after the other, row by row
    starts: Rows  # (L,) index of each level's first texel


@lru_cache(maxsize=8)
def floor(seed: int) -> Floor:
    """Return the floor of a seed, for any number of cameras and flights."""
    rng = np.random.default_rng([seed, _STREAM])
    frequency = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.fft.rfftfreq(SIDE))
    frequency[0, 0] = np.inf
    stains = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((SIDE, SIDE))) / frequency**ROUGHNESS)
    tiles = rng.normal(0.0, TILE_STD, (SIDE // TILE, SIDE // TILE))
    texture = GRAY + STAIN_STD * stains / stains.std() + np.kron(tiles, np.ones((TILE, TILE)))
    joint = np.arange(SIDE) % TILE < JOINT
    texture -= JOINT_CONTRAST * (joint[:, None] | joint)
    levels = [texture]
    while len(levels[-1]) > 1:
        finer = levels[-1]
        levels.append(finer.reshape(len(finer) // 2, 2, -1, 2).mean(axis=(1, 3)))
    sizes = [level.size for level in levels]
    return Floor(
        np.concatenate([level.ravel() for level in levels]).clip(0, 255).round().astype(np.uint8),
        np.cumsum([0, *sizes[:-1]]),
    )


@compiled
def draw_floor(
    canvas: Canvas, exposure: Exposure, floor: Floor, ground: Record, slices: int
) -> None:
    """Fill what is not covered yet with obstacles, the floor, or the background.

    A pixel samples the level whose texels are about as large as its own area on the floor, which is
    ``depth³ / height`` times its solid angle at the middle of the image, with linear interpolation.

    Args:
        canvas: Light is increased.
        exposure: The image.
        floor: Its texture.
        ground: `GROUND`.
        slices: Number of slices of the exposure to sample, around its middle.
    """
    light, gap, depth, shade = canvas
    rays, poses, lens, starts = exposure.rays, exposure.poses, exposure.lens, floor.starts
    first = (poses.shape[1] - slices) // 2
    middle = poses.shape[1] // 2
    height = max(poses[poses.shape[0] // 2, middle, 11], TEXEL)
    limits = np.empty(len(starts))
    for level in range(len(limits)):  # depth at which the next level begins
        limits[level] = (height * lens.fx * lens.fy * TEXEL**2 * 2.0 * 4.0**level) ** (1 / 3)
    limits[-1] = math.inf
    width = light.shape[1]
    total, reach = np.empty(width), np.empty(width)
    across, down = np.empty(width), np.empty(width)
    map_ = np.empty(9)
    for v in range(light.shape[0]):
        total[:] = 0.0
        for k in range(first, first + slices):
            away = plane_homography(poses[v, k], ground, TEXEL, 0.0, map_)
            _intersect(rays[0, v], rays[1, v], map_, away, across, down, reach)
            _sample(across, down, reach, floor, limits, total)
        for u in range(width):
            gray = total[u] / slices if reach[u] > 0.0 else BACKGROUND
            light[v, u] += gap[v, u] * (gray if depth[v, u] == math.inf else shade[v, u])


@subroutine
def _intersect(
    xs: Record, ys: Record, map_: Record, away: float, across: Record, down: Record, reach: Record
) -> None:
    """Intersect the rays of one row with the floor.

    This loop has neither branches nor look-ups, so that the compiler can vectorize it.

    Args:
        xs: (W,) of directions.
        ys: (W,) of directions.
        map_: (9,) homography from directions to texels.
        away: m, of `plane_homography`.
        across: (W,) overwritten with texels along x.
        down: (W,) overwritten with texels against y.
        reach: (W,) overwritten with depths, m; not positive above the horizon.
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


@subroutine
def _sample(
    across: Record, down: Record, reach: Record, floor: Floor, limits: Record, total: Record
) -> None:
    """Add the floor's gray values in one row to `total`.

    Indices are unsigned, which saves the test for negative ones.

    Args:
        across: (W,) texels along x.
        down: (W,) texels against y.
        reach: (W,) depths, m.
        floor: Its texture.
        limits: (L,) depth at which each level ends, m.
        total: (W,) gray values, increased.
    """
    texels, starts = floor
    level, scale, last, start = 0, 1.0, np.uint32(SIDE - 1), np.uint64(starts[0])
    unit, shift = np.uint32(1), np.uint32(0)
    for u in range(len(across)):
        far = reach[u]
        if not 0.0 < far < MAX_DEPTH:
            total[u] += GRAY
            continue
        if far > limits[level] or (level > 0 and far <= limits[level - 1]):
            while far > limits[level]:
                level += 1
            while level > 0 and far <= limits[level - 1]:
                level -= 1
            scale, shift = 0.5**level, np.uint32(level)
            last, start = np.uint32((SIDE >> level) - 1), np.uint64(starts[level])
        s, t = across[u] * scale + OFFSET, down[u] * scale + OFFSET
        column, row = np.uint32(s), np.uint32(t)
        right, under = s - column, t - row
        upper = start + np.uint64((row & last) * (np.uint32(SIDE) >> shift))
        lower = start + np.uint64(((row + unit) & last) * (np.uint32(SIDE) >> shift))
        west, east = np.uint64(column & last), np.uint64((column + unit) & last)
        a, b = float(texels[upper + west]), float(texels[upper + east])
        c, d = float(texels[lower + west]), float(texels[lower + east])
        a += right * (b - a)
        c += right * (d - c)
        total[u] += a + under * (c - a)
