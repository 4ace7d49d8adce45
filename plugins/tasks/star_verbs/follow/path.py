"""A polyline to fly along, by the distance flown on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from star_core import Array


class Path:
    """A polyline, measured along its length.

    Points that repeat the previous one are dropped, with their headings. A line whose last point
    equals its first is closed: distances wrap around. On an open one, distances before the start or
    past the end are at the start or the end.

    Args:
        point: (M, 3) corners, at least two that differ, m.
        yaw_deg: (M,) heading at each corner, degrees; interpolated the shorter way around between
            corners. Empty for none.

    Attributes:
        length: From start to end, or one lap if it is closed, m.
    """

    def __init__(self, point: Sequence[Sequence[float]], yaw_deg: Sequence[float] = ()) -> None:
        corner = np.array(point, np.float64)
        fresh = np.ones(len(corner), np.bool_)
        fresh[1:] = (corner[1:] != corner[:-1]).any(axis=1)
        corner = corner[fresh]
        offset = np.diff(corner, axis=0)
        stretch = np.sqrt((offset**2).sum(axis=1))
        self._corner = corner
        self._passed = np.concatenate([[0.0], np.cumsum(stretch)])
        self._tangent = offset / stretch[:, None]
        self._closed = bool((corner[0] == corner[-1]).all())
        self._yaw = np.unwrap(np.radians(np.array(yaw_deg)[fresh])) if len(yaw_deg) else None
        self.length = float(self._passed[-1])

    def at(self, distance: Array) -> tuple[Array, Array]:
        """Return (K, 3) points, m, and (K, 3) unit vectors along the line, at (K,) distances, m."""
        on = self._on(distance)
        stretch = np.searchsorted(self._passed, on, "right") - 1
        stretch = np.minimum(stretch, len(self._tangent) - 1)
        tangent = self._tangent[stretch]
        return self._corner[stretch] + tangent * (on - self._passed[stretch])[:, None], tangent

    def yaw(self, distance: Array) -> Array | None:
        """Return (K,) headings at (K,) distances, rad; None if the line has none."""
        if self._yaw is None:
            return None
        yaw: Array = np.interp(self._on(distance), self._passed, self._yaw)
        return yaw

    def _on(self, distance: Array) -> Array:
        if self._closed:
            return np.mod(distance, self.length)
        return np.clip(distance, 0.0, self.length)
