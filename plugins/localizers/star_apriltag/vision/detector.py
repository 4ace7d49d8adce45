"""Detects the tags in an image, and fits lines to their edges."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from star_apriltag.vision.quads import dark_quads, pyramid
from star_apriltag.vision.tag_code import MIN_CORRELATION, bordered, module_grid, read_codes
from star_core import Array, Image, Rows
from star_core.toolkit import CameraModel

MIN_SEPARATION: Final = 0.4  # of a tag's diagonal, between the centers of two tags


@dataclass(frozen=True, slots=True)
class TagDetections:
    """The tags of one image."""

    tag: Rows  # (K,) numbers
    # (K, 4, 2) px: bottom left, bottom right, top right and top left of each tag as OpenCV draws
    # it; the images of the family's authors are rotated by 180°
    corners: Array
    misfit: Array  # (K,) root mean square deviation of the edges from straight lines, px


class Detector:
    """A detector of tag36h11.

    Candidates are the dark quadrilaterals of `quads`. Their corners are found to a fraction of a
    pixel by `refine`; candidates without clear edges are dropped. `tag_code` reads the modules
    within. Tags with modules from about a pixel on are found, at any resolution of the image.
    """

    def __init__(self, lens: CameraModel) -> None:
        self._lens = lens

    def detect(self, image: Image) -> TagDetections:
        """Return the tags in an image.

        Raises:
            ValueError: It is no gray image of the camera's size.
        """
        tags: list[tuple[int, Array, float]] = []
        for level, smaller in enumerate(pyramid(checked(image, self._lens))):
            tags += self._new_tags(smaller, 2.0**level, [corners for _, corners, _ in tags])
        return TagDetections(
            np.array([tag for tag, *_ in tags], np.int64),
            np.array([corners for _, corners, _ in tags]).reshape(-1, 4, 2),
            np.array([misfit for *_, misfit in tags], np.float64),
        )

    def _new_tags(
        self, image: Image, scale: float, earlier: list[Array]
    ) -> Iterator[tuple[int, Array, float]]:
        """Yield number, corners and misfit of the tags in an image with pixels `scale` as large.

        Args:
            image: Of the pyramid.
            scale: Pixels of the camera per pixel of the image, along each side.
            earlier: (4, 2) corners of tags that were found before, px of the camera.
        """
        quads = dark_quads(image)
        quads = quads[bordered(module_grid(image, quads))]
        new = [quad for quad in quads if not any(_same((quad + 0.5) * scale, k) for k in earlier)]
        if not new:
            return
        corners, misfit = refine(image, np.array(new), self._lens, scale)
        clear = np.isfinite(misfit)
        corners, misfit = corners[clear], misfit[clear]
        codes = read_codes(module_grid(image, (corners + 0.5) / scale - 0.5))
        for k in np.flatnonzero(codes.correlation >= MIN_CORRELATION).tolist():
            yield int(codes.tag[k]), np.roll(corners[k], -codes.turns[k], axis=0), misfit[k]


def checked(image: Image, lens: CameraModel) -> Image:
    """Return an image whose rows are contiguous in memory.

    Raises:
        ValueError: It is no gray image of the camera's size.
    """
    if image.shape != lens.shape or image.dtype != np.uint8:
        raise ValueError(
            f"image is {image.shape!r} of {image.dtype}, expected {lens.shape!r} of uint8"
        )
    return np.ascontiguousarray(image)


def _same(corners: Array, other: Array) -> bool:
    """Return whether the (4, 2) corners of two quadrilaterals belong to the same tag."""
    apart = np.linalg.norm(corners.mean(axis=0) - other.mean(axis=0))
    return bool(apart < MIN_SEPARATION * np.linalg.norm(other[0] - other[2]))


POINTS: Final = 24  # along each side
STEP: Final = 0.25  # px, between samples across a side
APART: Final = 2  # steps to each of the two samples whose difference is the gradient at a point
REACHES: Final = (2.0, 1.25)  # px, distance from the side at which an edge is searched, per pass
MARGIN: Final = 1.5  # px, from a corner, within which the other side's blur disturbs
MIN_RISE: Final = 8.0  # gray values per pixel; camera noise is about four
MAX_SHIFT: Final = 3.0  # px, of a corner
MIN_ANGLE: Final = 1e-3  # rad, between adjacent sides
PREVIOUS: Final = [3, 0, 1, 2]
NEXT: Final = [1, 2, 3, 0]


def refine(
    image: Image, corners: Array, lens: CameraModel, scale: float = 1.0
) -> tuple[Array, Array]:
    """Return the corners of tags.

    Brightness is sampled across each side at many points; the edge is at the mean position of its
    outward rise, weighted by the rise, much as in the AprilTag 3 library (Krogius, Haggenmiller and
    Olson, IROS 2019). The weight is the cube of the rise over one pixel: on far tags, whose borders
    are hardly wider than the blur, that is affected least by what lies beyond them. A line is
    fitted to each side's points by least squares, on rays, where sides are straight; adjacent lines
    intersect in the corners.

    Args:
        image: As the lens shows it, or smaller.
        corners: (K, 4, 2) px of that image, anticlockwise in it, to about a pixel.
        lens: The camera.
        scale: Pixels of the lens per pixel of the image, along each side.

    Returns:
        (K, 4, 2) px of the lens, and the (K,) root mean square distances of the edges' points from
        their lines, likewise; NaN for a tag without clear sides.
    """
    estimate, clear = corners, np.ones(len(corners), np.bool_)
    spread = np.zeros(len(corners))
    for reach in REACHES:
        points, weight = _edge(image, estimate, reach)
        clear = clear & (np.count_nonzero(weight, axis=2) >= POINTS // 2).all(axis=1)
        lines, square = _lines(lens.undistort((points + 0.5) * scale - 0.5), weight)
        meet = _intersection(lines[:, PREVIOUS], lines)
        clear = clear & (np.abs(meet[..., 2]) > MIN_ANGLE).all(axis=1)
        meet[~clear] = 1.0
        corners_now = (lens.project(meet) + 0.5) / scale - 0.5
        clear = clear & (np.abs(corners_now - corners).max(axis=(1, 2)) < MAX_SHIFT)
        estimate = np.where(clear[:, None, None], corners_now, corners)
        spread = square.mean(axis=1) * lens.matrix[0, 0] * lens.matrix[1, 1]
    return (estimate + 0.5) * scale - 0.5, np.where(clear, np.sqrt(np.maximum(spread, 0.0)), np.nan)


def _edge(image: Image, corners: Array, reach: float) -> tuple[Array, Array]:
    """Return (K, 4, POINTS, 2) points of the edges, px, and their (K, 4, POINTS) weights."""
    side = corners[:, NEXT] - corners
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
    gray = sampled.reshape(u.shape).astype(np.float64)
    rise = np.maximum(gray[..., 2 * APART :] - gray[..., : -2 * APART], 0.0)
    clear = rise.max(axis=-1) >= MIN_RISE
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


def _intersection(line: Array, other: Array) -> Array:
    """Return the intersections of (..., 3) lines, homogeneous, (..., 3)."""
    a, b, c = line[..., 0], line[..., 1], line[..., 2]
    d, e, f = other[..., 0], other[..., 1], other[..., 2]
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=-1)


_SHARES = np.linspace(0.0, 1.0, POINTS)
