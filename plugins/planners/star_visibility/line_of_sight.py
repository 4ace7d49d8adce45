"""Line of sight between two points, and whether a point is inside region."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask, Rows
from star_core.toolkit import compiled, subroutine
from star_visibility.regions import Regions

TOUCH = 1e-10  # m; nearer than this is on the line
LEVEL = 1e-9  # m; heights that differ by less are equal


@subroutine
def meets(region: Regions, band: int, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether the segment from a to b, excluding its ends, meets an outline of a band.

    Touching counts: a path past a corner is two segments that end there.
    """
    return meeting(region, band, ax, ay, bx, by, True) < math.inf  # noqa: FBT003


@subroutine
def meeting(
    region: Regions,
    band: int,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    anywhere: bool,  # noqa: FBT001
) -> float:
    """Return the distance from a at which the segment to b first meets an outline, m; or infinity.

    With `anywhere` it is any meeting, not the first.
    """
    nearest: float = math.inf
    length = math.hypot(bx - ax, by - ay)
    if length <= 2 * TOUCH:
        return nearest
    ux, uy = (bx - ax) / length, (by - ay) / length
    left, right = min(ax, bx) - TOUCH, max(ax, bx) + TOUCH
    bottom, top = min(ay, by) - TOUCH, max(ay, by) + TOUCH
    for ring in range(region.first_ring[band], region.first_ring[band + 1]):
        box = region.box[ring]
        x0, y0, x1, y1 = box[0], box[1], box[2], box[3]
        if x0 > right or x1 < left or y0 > top or y1 < bottom:
            continue
        aside = ux * ((y0 + y1) / 2 - ay) - uy * ((x0 + x1) / 2 - ax)  # of the box's middle
        if abs(aside) > (abs(ux) * (y1 - y0) + abs(uy) * (x1 - x0)) / 2 + TOUCH:
            continue
        begin, end = region.first_corner[ring], region.first_corner[ring + 1]
        dx, dy = region.corner[end - 1, 0] - ax, region.corner[end - 1, 1] - ay
        beside, along = ux * dy - uy * dx, ux * dx + uy * dy
        for k in range(begin, end):
            before, passed = beside, along
            dx, dy = region.corner[k, 0] - ax, region.corner[k, 1] - ay
            beside, along = ux * dy - uy * dx, ux * dx + uy * dy
            if abs(beside) <= TOUCH:
                at = along
            elif abs(before) <= TOUCH or (before > 0) == (beside > 0):
                continue  # a corner on the line was handled where its edge ended
            else:
                at = passed + (along - passed) * before / (before - beside)
            if TOUCH < at < min(length - TOUCH, nearest):
                nearest = at
                if anywhere:
                    return nearest
    return float(nearest)


@subroutine
def within(region: Regions, band: int, x: float, y: float) -> bool:
    """Whether a point is inside the forbidden region of a band; on its outline it may be either."""
    odd = False
    for ring in range(region.first_ring[band], region.first_ring[band + 1]):
        box = region.box[ring]
        x0, y0, x1, y1 = box[0], box[1], box[2], box[3]
        if x < x0 or x > x1 or y < y0 or y > y1:
            continue
        begin, end = region.first_corner[ring], region.first_corner[ring + 1]
        px, py = region.corner[end - 1, 0], region.corner[end - 1, 1]
        for k in range(begin, end):
            qx, qy = region.corner[k, 0], region.corner[k, 1]
            if (py > y) != (qy > y) and x < px + (y - py) / (qy - py) * (qx - px):
                odd = not odd
            px, py = qx, qy
    return odd


@subroutine
def on_outline(region: Regions, band: int, x: float, y: float) -> bool:
    """Whether a point is on an outline of a band, within rounding."""
    near = 10 * TOUCH
    for ring in range(region.first_ring[band], region.first_ring[band + 1]):
        box = region.box[ring]
        x0, y0, x1, y1 = box[0], box[1], box[2], box[3]
        if x < x0 - near or x > x1 + near or y < y0 - near or y > y1 + near:
            continue
        begin, end = region.first_corner[ring], region.first_corner[ring + 1]
        px, py = region.corner[end - 1, 0], region.corner[end - 1, 1]
        for k in range(begin, end):
            qx, qy = region.corner[k, 0], region.corner[k, 1]
            nx, ny = nearest_on(px, py, qx, qy, x, y)
            if math.hypot(nx - x, ny - y) <= near:
                return True
            px, py = qx, qy
    return False


@subroutine
def nearest_on(
    px: float, py: float, qx: float, qy: float, x: float, y: float
) -> tuple[float, float]:
    """Return the point of the segment from p to q that is nearest to x, y."""
    ux, uy = qx - px, qy - py
    share = ((x - px) * ux + (y - py) * uy) / max(ux * ux + uy * uy, 1e-300)
    share = min(max(share, 0.0), 1.0)
    return px + share * ux, py + share * uy


@subroutine
def band_of(region: Regions, z: float) -> int:
    """Return the band that contains a height; on a level it is the one above."""
    band = 0
    while band + 2 < len(region.level) and z >= region.level[band + 1]:
        band += 1
    return band


@compiled
def covered(region: Regions, x: float, y: float, z: float) -> bool:
    """Whether a point is inside a forbidden region, or on its outline within rounding.

    On a level it is free if it is free in one of the two bands that meet there.
    """
    band = band_of(region, z)
    if not (within(region, band, x, y) or on_outline(region, band, x, y)):
        return False
    if band > 0 and z - region.level[band] <= LEVEL:
        return within(region, band - 1, x, y) or on_outline(region, band - 1, x, y)
    if band + 2 < len(region.level) and region.level[band + 1] - z <= LEVEL:
        return within(region, band + 1, x, y) or on_outline(region, band + 1, x, y)
    return True


@subroutine
def open_in(region: Regions, band: int, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether no block of a band is on the segment from a to b."""
    if within(region, band, (ax + bx) / 2, (ay + by) / 2):
        return False
    return not meets(region, band, ax, ay, bx, by)


@compiled
def sees(region: Regions, a: Array, b: Array) -> bool:
    """Whether the segment from `a` to `b`, (3,) m each, is free in every band it crosses."""
    bottom, top = region.level[0], region.level[-1]
    za, zb = min(max(a[2], bottom), top), min(max(b[2], bottom), top)
    if abs(zb - za) <= LEVEL:
        band = band_of(region, za)
        if open_in(region, band, a[0], a[1], b[0], b[1]):
            return True
        if band > 0 and za - region.level[band] <= LEVEL:
            return open_in(region, band - 1, a[0], a[1], b[0], b[1])
        if band + 2 < len(region.level) and region.level[band + 1] - za <= LEVEL:
            return open_in(region, band + 1, a[0], a[1], b[0], b[1])
        return False
    for band in range(len(region.level) - 1):
        low, high = max(region.level[band], min(za, zb)), min(region.level[band + 1], max(za, zb))
        if high - low <= LEVEL:
            continue
        s, t = (low - za) / (zb - za), (high - za) / (zb - za)
        if not open_in(
            region,
            band,
            a[0] + s * (b[0] - a[0]),
            a[1] + s * (b[1] - a[1]),
            a[0] + t * (b[0] - a[0]),
            a[1] + t * (b[1] - a[1]),
        ):
            return False
    return True


@compiled
def all_see(region: Regions, a: Array, b: Array, rows: Rows) -> Mask:
    """Return for some rows whether the segment from `a` to `b`, (N, 3) m each, is free: (N,)."""
    answer = np.zeros(len(a), np.bool_)
    for i in rows:
        answer[i] = sees(region, a[i], b[i])
    return answer
