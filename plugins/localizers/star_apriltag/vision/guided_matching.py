"""Guided matching: finds tags that were not detected at their expected pixels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from star_apriltag.vision.body_pose import MIN_DEPTH, View
from star_apriltag.vision.expected_tags import ExpectedTag
from star_apriltag.vision.tag_poses import CELLS, MODULES, USUAL_SIZE
from star_core import Array, Image, Mask, Pose
from star_core.toolkit import CameraModel, square_corners

SEARCH_STDS: Final = 3.0  # standard deviations of the expected pixel that are searched
MARGIN: Final = 3.0  # px, beyond that
MAX_SEARCH: Final = 40.0  # px, to either side
MAX_PIXEL_STD: Final = 20.0  # px, of the expected pixel
MIN_SHARE: Final = 0.4  # of a tag with its border that is in the image
MIN_EDGE: Final = 6  # px, of the region that is compared
MAX_PIXELS: Final = 10_000  # in that; a larger one is near, and takes long

COVERAGE: Final = 0.5  # of a pixel, above which it is compared
MIN_CORRELATION: Final = 0.6  # of the tag with its border
MIN_LEAD: Final = 0.08  # of that over any other pixel's
LOBE: Final = 3  # px around the peak that belong to it

MIN_CODE_CORRELATION: Final = 0.7
"""Of the code alone. Borders look the same on every tag: a wrong one of the same size correlates by
two thirds, but its code hardly does."""

MIN_CODE_PIXELS: Final = 10  # fewer are not significant
MIN_CONTRAST: Final = 8.0  # gray values, standard deviation over the tag; camera noise is about 4
MAX_CORRELATION: Final = 1.001  # a larger one is a rounding error, without contrast

# Standard deviation of a center, px: MIN_STD, and more for each meter to a tag of USUAL_SIZE. In
# simulation a center is found to 0.15 px. Errors of the map are states of `JointFilter`.
MIN_STD: Final = 0.18
STD_PER_METER: Final = 0.05


class TagMatch(NamedTuple):
    """A tag that was found where it was expected."""

    tag: int  # its number
    pixel: Array  # (2,) its center, px
    corners: Array  # (4, 2) px, as expected around that
    view: View  # the same as a measurement, of one point
    correlation: float  # with its template, at most 1


def match_tag(image: Image, expected: ExpectedTag, lens: CameraModel) -> TagMatch | None:
    """Return an expected tag's position in an image, or None if it is not clearly visible.

    A template of the tag is compared with the image at all pixels near the expected one, by
    normalized cross-correlation over the tag's paper. The tag is found if one peak is clearly above
    all others, and if the code is its own.
    """
    spread = np.sqrt(expected.covariance.diagonal())
    if not spread.max() <= MAX_PIXEL_STD:
        return None
    region = _region(expected, lens, spread)
    if region is None:
        return None
    tag = expected.tag
    drawn = template(tag.number, tag.size, expected.pose, lens, region)
    reach = np.ceil(np.minimum(SEARCH_STDS * spread + MARGIN, MAX_SEARCH)).astype(int)
    across, down = reach.tolist()
    left, top = max(region.left - across, 0), max(region.top - down, 0)
    window = image[top : region.bottom + down, left : region.right + across].astype(np.float32)
    correlation = cv2.matchTemplate(
        window, drawn.gray, cv2.TM_CCOEFF_NORMED, mask=_covered(drawn.paper).astype(np.float32)
    )
    peak = _peak(np.asarray(correlation, np.float32))
    if peak is None:
        return None
    u, v = peak
    column, row = round(u), round(v)
    height, width = drawn.gray.shape
    if not _readable(window[row : row + height, column : column + width], drawn):
        return None
    pixel = expected.pixel + np.array([u + left - region.left, v + top - region.top])
    ray = lens.undistort(pixel)
    if not np.isfinite(ray).all():
        return None
    deviation = math.hypot(MIN_STD, STD_PER_METER * expected.distance * USUAL_SIZE / tag.size)
    view = View(
        tag.pose.position[None],
        ray[None],
        deviation / float(lens.magnification(ray)),
        lens.row_delay(pixel)[None],
    )
    corners = lens.project(expected.pose.apply(square_corners(tag.size)))
    corners += pixel - expected.pixel
    return TagMatch(tag.number, pixel, corners, view, float(correlation[row, column]))


def without_overlaps(
    matches: Sequence[TagMatch], accepted: Iterable[Array]
) -> tuple[TagMatch, ...]:
    """Return the matches whose centers are not on a tag that is more certain, in their order.

    A tag of which only a part is in the image may correlate with its neighbor on the sheet. A tag
    that was detected and accepted is more certain than a match, and so is a match that correlates
    better.

    Args:
        matches: Of one image.
        accepted: (4, 2) corners of each tag that was detected in it and accepted, px.
    """
    outlines = [corners.astype(np.float32) for corners in accepted]
    kept = []
    for match in sorted(matches, key=lambda match: -match.correlation):
        u, v = match.pixel.tolist()
        if all(
            cv2.pointPolygonTest(outline, (u, v), measureDist=False) < 0 for outline in outlines
        ):
            kept.append(match.tag)
            outlines.append(match.corners.astype(np.float32))
    return tuple(match for match in matches if match.tag in kept)


def _region(expected: ExpectedTag, lens: CameraModel, spread: Array) -> Region | None:
    """Return the region of the image that is compared, or None if it has too little of the tag.

    At the image's edges a standard deviation is left for the tag to be farther out.
    """
    ahead = expected.pose.apply(expected.tag.outline)
    if not ahead[:, 2].min() > MIN_DEPTH:
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
    if min(edges) < MIN_EDGE or math.prod(edges) > MAX_PIXELS:
        return None
    whole = outline.astype(np.float32)
    inside, _ = cv2.intersectConvexConvex(whole, region.corners)
    return region if inside >= MIN_SHARE * cv2.contourArea(whole) else None


def _peak(correlation: Picture) -> tuple[float, float] | None:
    """Return column and row of the peak, or None if it is not clearly above the rest.

    Between pixels it is the vertex of the parabola through three of them.
    """
    plain = np.float32(0.0)
    correlation = np.where(np.abs(correlation) < MAX_CORRELATION, correlation, plain)
    _, best, _, (column, row) = cv2.minMaxLoc(correlation)
    rows, columns = correlation.shape
    if best < MIN_CORRELATION or not (0 < row < rows - 1 and 0 < column < columns - 1):
        return None
    rest = correlation.copy()
    rest[max(0, row - LOBE) : row + LOBE + 1, max(0, column - LOBE) : column + LOBE + 1] = 0.0
    if rest.max() > best - MIN_LEAD:
        return None
    across = correlation[row, column - 1 : column + 2]
    down = correlation[row - 1 : row + 2, column]
    return column + _vertex(*across.tolist()), row + _vertex(*down.tolist())


def _vertex(before: float, middle: float, after: float) -> float:
    """Return a parabola's vertex, from -0.5 to 0.5 if no value is above the middle one."""
    bend = before - 2 * middle + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0


def _readable(patch: Picture, drawn: Template) -> bool:
    """Return whether a patch has contrast, and shows the tag's own code."""
    code = _covered(drawn.code)
    if patch[_covered(drawn.paper)].std() < MIN_CONTRAST:
        return False
    if np.count_nonzero(code) < MIN_CODE_PIXELS:
        return False
    image, reference = (gray[code] - gray[code].mean() for gray in (patch, drawn.gray))
    both = math.sqrt(float(image @ image) * float(reference @ reference))
    return float(image @ reference) >= MIN_CODE_CORRELATION * both > 0


def _covered(share: Picture) -> Mask:
    return share > COVERAGE


Picture = NDArray[np.float32]

SAMPLES: Final = 3  # per pixel along each side
BLUR_STD: Final = 0.7  # px, of a small lens; from 0.4 to 1.1 is as good


class Region(NamedTuple):
    """A region of an image: the first column and row, and the ones past the last."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def corners(self) -> Picture:
        """(4, 2) px; the center of the first pixel is at (0, 0)."""
        left, top, right, bottom = self
        points = [[left, top], [right, top], [right, bottom], [left, bottom]]
        return np.array(points, np.float32) - np.float32(0.5)


class Template(NamedTuple):
    """Expected content of a region."""

    gray: Picture  # (h, w) from 0 for ink to 1 for paper
    paper: Picture  # (h, w) share of each pixel that the tag with its border covers
    code: Picture  # (h, w) share of each pixel that its code covers


def template(number: int, size: float, tag: Pose, lens: CameraModel, region: Region) -> Template:
    """Return a tag of family 36h11 as it appears in a region of the image.

    Each pixel is the mean over `SAMPLES` by `SAMPLES` rays, blurred like a lens. The region has at
    least one pixel of the image around it; the tag's pose is that in the camera, its size in m.
    """
    left, top, right, bottom = region
    rays = lens.rays[top - 1 : bottom + 1, left - 1 : right + 1]
    fine = cv2.resize(rays, None, fx=SAMPLES, fy=SAMPLES, interpolation=cv2.INTER_LINEAR)
    fine = np.ascontiguousarray(fine[SAMPLES:-SAMPLES, SAMPLES:-SAMPLES])
    scale, middle = MODULES / size, (CELLS - 1) / 2
    to_cells = np.array([[scale, 0, middle], [0, -scale, middle], [0, 0, 1]])
    plane = np.column_stack([tag.rotation[:, :2], tag.position])  # x, y and 1 to a ray
    cells = cv2.perspectiveTransform(fine, to_cells @ np.linalg.inv(plane))
    cells[np.isnan(fine)] = -1.0
    columns, rows = cv2.split(cells)
    image = cv2.remap(
        _print(number), columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT
    )
    image = cv2.resize(image, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), BLUR_STD)
    light, paper, code = (np.asarray(image[..., i], np.float32) for i in range(3))
    light /= np.maximum(paper, _MIN_PAPER)
    return Template(light, paper, code)


@cache
def _print(number: int) -> Picture:
    """Return a tag's cells, (CELLS, CELLS, 3), top row first: gray, paper and code."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    cells = np.ones((CELLS, CELLS, 3), np.float32)
    cells[1:-1, 1:-1, 0] = cv2.aruco.generateImageMarker(family, number, MODULES) > 0
    cells[..., 2] = 0
    cells[2:-2, 2:-2, 2] = 1
    return cells


_MIN_PAPER = np.float32(1e-3)
