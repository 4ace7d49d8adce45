"""Where the corners of tags are to a fraction of a pixel: straight lines along their sides."""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np

from star_core import Array, CameraModel, Image

POINTS: Final = 24  # along each side
STEP: Final = 0.25  # px, between samples across a side
APART: Final = 2  # steps to each of the two samples whose difference is the rise at a place
REACHES: Final = (2.0, 1.25)  # px, how far from the side an edge is looked for, in each pass
MARGIN: Final = 1.5  # px, next to a corner: the other side's edge blurs in there
LEAST_RISE: Final = 8.0  # grey values over a pixel; camera noise is about four
FAR: Final = 3.0  # px, further from where it was found no corner moves
LEAST_ANGLE: Final = 1e-3  # rad, between neighbouring sides
BEFORE: Final = [3, 0, 1, 2]
AFTER: Final = [1, 2, 3, 0]


class Corners(NamedTuple):
    """The corners of tags.

    Attributes:
        pixels: (K, 4, 2) px.
        misfit: (K,) root mean square distance of the edges' points from their lines, px; NaN where
            the sides of a tag cannot be made out.
    """

    pixels: Array
    misfit: Array


def refine(image: Image, corners: Array, lens: CameraModel) -> Corners:
    """Return the corners of tags.

    Brightness is sampled across each side at many points; the edge lies at the mean of the places
    where it rises outwards, weighted by the rise, much as in the AprilTag 3 library (Krogius,
    Haggenmiller and Olson, IROS 2019). The weight is the cube of the rise over one pixel: on far
    tags, whose border and rim are hardly wider than the blur, that reaches least into what lies
    beyond them. A line is fitted through each side's points by least squares, on rays, for only
    there is a side straight; neighbours meet in the corners.

    Args:
        image: As the lens shows it.
        corners: (K, 4, 2) px, anticlockwise as one sees them, to about a pixel.
        lens: What took it.
    """
    found, clear = corners, np.ones(len(corners), np.bool_)
    spread = np.zeros(len(corners))
    for reach in REACHES:
        points, weight = _edge(image, found, reach)
        clear = clear & (np.count_nonzero(weight, axis=2) >= POINTS // 2).all(axis=1)
        lines, square = _lines(lens.undistort(points), weight)
        meet = _meet(lines[:, BEFORE], lines)
        clear = clear & (np.abs(meet[..., 2]) > LEAST_ANGLE).all(axis=1)
        meet[~clear] = 1.0
        there = lens.project(meet)
        clear = clear & (np.abs(there - corners).max(axis=(1, 2)) < FAR)
        found = np.where(clear[:, None, None], there, corners)
        spread = square.mean(axis=1) * lens.matrix[0, 0] * lens.matrix[1, 1]
    return Corners(found, np.where(clear, np.sqrt(np.maximum(spread, 0.0)), np.nan))


def _edge(image: Image, corners: Array, reach: float) -> tuple[Array, Array]:
    """Return (K, 4, POINTS, 2) places of the edges, px, and their (K, 4, POINTS) weights."""
    side = corners[:, AFTER] - corners
    length = np.maximum(np.hypot(side[..., 0], side[..., 1]), 1.0)[..., None]
    outward = np.stack([-side[..., 1], side[..., 0]], axis=-1) / length
    margin = np.minimum(MARGIN / length, 0.25)
    share = margin + (1 - 2 * margin) * _SHARES  # (K, 4, POINTS) of the way along
    foot = corners[:, :, None] + share[..., None] * side[:, :, None]
    last = round(reach / STEP)
    across = np.arange(-last - APART, last + APART + 1) * STEP
    u, v = (
        (foot[..., None, i] + across * outward[..., None, None, i]).astype(np.float32)
        for i in (0, 1)
    )
    rows = (-1, len(across))
    sampled = cv2.remap(
        image, u.reshape(rows), v.reshape(rows), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    grey = sampled.reshape(u.shape).astype(np.float64)
    rise = np.maximum(grey[..., 2 * APART :] - grey[..., : -2 * APART], 0.0)
    clear = rise.max(axis=-1) >= LEAST_RISE
    power = rise**3
    total = power.sum(axis=-1)
    offset = power @ across[APART:-APART] / np.maximum(total, 1.0)
    return foot + offset[..., None] * outward[:, :, None], np.where(clear, np.sqrt(total), 0.0)


def _lines(points: Array, weight: Array) -> tuple[Array, Array]:
    """Fit lines through (K, 4, P, 2) points with (K, 4, P) weights.

    Returns:
        (K, 4, 3) ``n x + d = 0`` with n of length 1, and the (K, 4) mean squared distances.
    """
    full = np.ones((*weight.shape, 3))
    full[..., :2] = points
    moments = (full * weight[..., None]).swapaxes(-1, -2) @ full
    moments /= np.maximum(moments[..., 2:, 2:], 1.0)
    mean = moments[..., 2, :2]
    xx, yy = (moments[..., i, i] - mean[..., i] ** 2 for i in (0, 1))
    xy = moments[..., 0, 1] - mean[..., 0] * mean[..., 1]
    half = (xx - yy) / 2
    angle = 0.5 * np.arctan2(xy, half) + np.pi / 2  # across the longer axis
    nx, ny = np.cos(angle), np.sin(angle)
    lines = np.stack([nx, ny, -(nx * mean[..., 0] + ny * mean[..., 1])], axis=-1)
    return lines, (xx + yy) / 2 - np.hypot(half, xy)


def _meet(one: Array, other: Array) -> Array:
    """Return where (..., 3) lines meet others: (..., 3), to be divided by the last."""
    a, b, c = one[..., 0], one[..., 1], one[..., 2]
    d, e, f = other[..., 0], other[..., 1], other[..., 2]
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=-1)


_SHARES = np.linspace(0.0, 1.0, POINTS)
