"""The shortest exit from a forbidden region."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Mask
from star_core.toolkit import compiled, subroutine
from star_visibility.line_of_sight import band_of, covered, nearest_on, sees, within
from star_visibility.regions import Regions

BEYOND = 1e-7  # m past the outline, so that the point is unambiguously outside


@compiled
def way_out(region: Regions, passable: Regions, point: Array, low: Array, high: Array) -> Array:
    """Return the free point nearest to one that is not free: (3,) m; all NaN if there is none.

    It is beside, above or below `point`.

    Args:
        region: Region to leave.
        passable: Region that the exit must not cross.
        point: (3,) m.
        low: (3,) least x, y and z of the exit, m.
        high: (3,) greatest x, y and z, m.
    """
    x, y = point[0], point[1]
    best = np.array([np.nan, np.nan, np.nan])
    least = np.inf
    candidate = point.copy()
    band = band_of(region, point[2])
    for other in range(len(region.level) - 1):
        if other != band and not within(region, other, x, y):
            z = region.level[other] if other > band else region.level[other + 1]
            candidate[2] = z
            if abs(z - point[2]) < least and sees(passable, point, candidate):
                least = abs(z - point[2])
                best = candidate.copy()
    candidate[2] = point[2]
    first = region.first_corner[region.first_ring[band]]
    failed = np.zeros(region.first_corner[region.first_ring[band + 1]] - first, np.bool_)
    while True:
        edge = _nearest(region, band, x, y, failed, least, candidate)
        if edge < 0:
            return best
        if (
            low[0] <= candidate[0] <= high[0]
            and low[1] <= candidate[1] <= high[1]
            and not covered(region, candidate[0], candidate[1], candidate[2])
            and sees(passable, point, candidate)
        ):
            return candidate
        failed[edge] = True


@subroutine
def _nearest(
    region: Regions,
    band: int,
    x: float,
    y: float,
    failed: Mask,
    least: float,
    candidate: Array,
) -> int:
    """Return the nearest edge that has not failed; -1 if all are beyond `least`, m.

    The exit point is written to x and y of `candidate`.
    """
    nearest = -1
    first = region.first_corner[region.first_ring[band]]
    for ring in range(region.first_ring[band], region.first_ring[band + 1]):
        begin, end = region.first_corner[ring], region.first_corner[ring + 1]
        px, py = region.corner[end - 1, 0], region.corner[end - 1, 1]
        for k in range(begin, end):
            qx, qy = region.corner[k, 0], region.corner[k, 1]
            nx, ny = nearest_on(px, py, qx, qy, x, y)
            distance = math.hypot(nx - x, ny - y)
            if distance < least and not failed[k - first]:
                nearest, least = k - first, distance
                ux, uy = nx - x, ny - y
                if distance < BEYOND:  # on the outline: perpendicular to it, to its right
                    ux, uy = qy - py, px - qx
                length = math.hypot(ux, uy)
                candidate[0] = nx + BEYOND * ux / length
                candidate[1] = ny + BEYOND * uy / length
            px, py = qx, qy
    return nearest
