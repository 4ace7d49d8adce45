"""Finds a tag that was not detected, where the map has it: guided matching."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import cv2
import numpy as np

from star_apriltag.vision.body_pose import NEAREST, View
from star_apriltag.vision.expected_tags import Expected
from star_apriltag.vision.tag_template import Picture, Region, Template, template
from star_core import Array, CameraModel, Image, Mask

DEVIATIONS: Final = 3.0  # of the expected place, within which a tag is looked for
MARGIN: Final = 3.0  # px, beyond that
WIDEST: Final = 40.0  # px, but no further
UNSURE: Final = 20.0  # px, deviation of the expected place beyond which matching is not guided
LEAST_SHARE: Final = 0.4  # of a tag with its rim that is in the image
LEAST_EDGE: Final = 6  # px, of the part that is compared
MOST_PIXELS: Final = 10_000  # of that; what is larger is near, and takes long

COVERED: Final = 0.5  # of a pixel, from which on it counts
LEAST_LIKENESS: Final = 0.6  # correlation of the tag with its rim
LEAST_LEAD: Final = 0.08  # by which that is above any other place's
LOBE: Final = 3  # px, around the likeliest place, that are no other one

LEAST_CODE: Final = 0.7
"""Correlation of the code alone. Border and rim look the same on every tag: a wrong one of the same
size correlates by two thirds, but its code hardly does."""

LEAST_CODE_PIXELS: Final = 10  # fewer say nothing
LEAST_CONTRAST: Final = 8.0  # grey values, deviation over the tag; camera noise is about four
CERTAIN: Final = 1.001  # no correlation is above, but by rounding where there is no contrast

# The deviation of a centre, px: LEAST, and more for each metre to a tag of 0.168 m. In simulation a
# centre is found to 0.15 px; the rest stands for what is wrong with the map, which lasts.
LEAST: Final = 0.25
PER_METRE: Final = 0.08


class Match(NamedTuple):
    """A tag that was found where it was expected.

    Attributes:
        tag: Its number.
        pixel: (2,) its centre, px.
        view: The same as a measurement, of one point.
        likeness: Correlation with what was expected, at most 1.
    """

    tag: int
    pixel: Array
    view: View
    likeness: float


def find(image: Image, expected: Expected, lens: CameraModel) -> Match | None:
    """Return where an expected tag is in an image, or None if it is not clearly seen there.

    What it should look like is compared with the image at every place near the expected one, by
    normalised cross-correlation. Compared is what is paper: nothing is known of what is around it.
    It is found if it is likelier at one place than at all others, and if the code is its own.

    Args:
        image: As the lens shows it.
        expected: The tag.
        lens: What it is seen through.
    """
    spread = np.sqrt(expected.covariance.diagonal())
    if not spread.max() <= UNSURE:
        return None
    region = _region(expected, lens, spread)
    if region is None:
        return None
    place = expected.place
    drawn = template(place.tag, place.size, expected.tag, lens, region)
    reach = np.ceil(np.minimum(DEVIATIONS * spread + MARGIN, WIDEST)).astype(int)
    across, down = reach.tolist()
    left, top = max(region.left - across, 0), max(region.top - down, 0)
    window = image[top : region.bottom + down, left : region.right + across].astype(np.float32)
    likeness = cv2.matchTemplate(
        window, drawn.grey, cv2.TM_CCOEFF_NORMED, mask=_counts(drawn.paper).astype(np.float32)
    )
    peak = _peak(np.asarray(likeness, np.float32))
    if peak is None:
        return None
    u, v = peak
    column, row = round(u), round(v)
    height, width = drawn.grey.shape
    if not _readable(window[row : row + height, column : column + width], drawn):
        return None
    shift = np.array([u + left - region.left, v + top - region.top])
    pixel = expected.pixel + shift
    ray = lens.undistort(pixel)
    if not np.isfinite(ray).all():
        return None
    deviation = math.hypot(LEAST, PER_METRE * expected.distance * 0.168 / place.size)
    view = View(
        place.pose.position[None],
        ray[None],
        deviation / float(lens.magnification(ray)),
        lens.row_delay(pixel)[None],
    )
    return Match(place.tag, pixel, view, float(likeness[row, column]))


def _region(expected: Expected, lens: CameraModel, spread: Array) -> Region | None:
    """The part of the image that is compared, or None if too little of the tag is in it.

    It leaves room at the image's edges for the tag to be a deviation further out.
    """
    ahead = expected.tag.apply(expected.place.outline)
    if not ahead[:, 2].min() > NEAREST:
        return None
    outline = lens.project(ahead)
    height, width = lens.shape
    across, down = (np.ceil(spread) + 1).astype(int).tolist()
    (left, top), (right, bottom) = outline.min(axis=0).tolist(), outline.max(axis=0).tolist()
    region = Region(
        max(math.floor(left), across),
        max(math.floor(top), down),
        min(math.ceil(right) + 1, width - across),
        min(math.ceil(bottom) + 1, height - down),
    )
    edges = region.right - region.left, region.bottom - region.top
    if min(edges) < LEAST_EDGE or math.prod(edges) > MOST_PIXELS:
        return None
    whole = outline.astype(np.float32)
    inside, _ = cv2.intersectConvexConvex(whole, region.corners)
    return region if inside >= LEAST_SHARE * cv2.contourArea(whole) else None


def _peak(likeness: Picture) -> tuple[float, float] | None:
    """Return the column and row of the likeliest place, or None if no place stands out.

    Between pixels it is where the parabola through three of them has its summit.
    """
    likeness = np.where(np.abs(likeness) < CERTAIN, likeness, np.float32(0.0))
    _, best, _, (column, row) = cv2.minMaxLoc(likeness)
    rows, columns = likeness.shape
    if best < LEAST_LIKENESS or not (0 < row < rows - 1 and 0 < column < columns - 1):
        return None
    rest = likeness.copy()
    rest[max(0, row - LOBE) : row + LOBE + 1, max(0, column - LOBE) : column + LOBE + 1] = 0.0
    if rest.max() > best - LEAST_LEAD:
        return None
    across = likeness[row, column - 1 : column + 2]
    down = likeness[row - 1 : row + 2, column]
    return column + _summit(*across.tolist()), row + _summit(*down.tolist())


def _summit(before: float, here: float, after: float) -> float:
    """Where a parabola has its summit, from -0.5 to 0.5 if no value is above the middle one."""
    bend = before - 2 * here + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0


def _readable(patch: Picture, drawn: Template) -> bool:
    """Return whether a patch has contrast, and shows the tag's own code."""
    code = _counts(drawn.code)
    if patch[_counts(drawn.paper)].std() < LEAST_CONTRAST:
        return False
    if np.count_nonzero(code) < LEAST_CODE_PIXELS:
        return False
    seen, known = (grey[code] - grey[code].mean() for grey in (patch, drawn.grey))
    both = math.sqrt(float(seen @ seen) * float(known @ known))
    return float(seen @ known) >= LEAST_CODE * both > 0


def _counts(share: Picture) -> Mask:
    return share > COVERED
