"""The Multi-ranger deck: distances along the body's axes to what is on the map.

Five sensors look forward, back, left, right and up. Each measures along one ray from the drone's
true position to the obstacles of the world and to the floor, up to 4 m, without noise; beyond,
and of what is not on the map, there is no echo. Drones are not seen, nor is the fence, which is no
wall. The cone of 27 degrees that a real sensor averages over is not modelled.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from star_core import Array, World
from star_core.toolkit import rotation_from_quaternion

AXES: Final = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], float)
"""(5, 3) directions of the sensors in the body: front, back, left, right, up."""
MAX_RANGE: Final = 4.0  # m, of a VL53L1x
NO_ECHO: Final = 32767  # mm
FIELD: Final = math.radians(45.0)  # of view of the 8 x 8 zones
_ZONES: Final = np.tan((np.arange(8) - 3.5) / 8 * FIELD)
ZONES: Final = np.array([[1.0, -aside, -below] for below in _ZONES for aside in _ZONES])
"""(64, 3) directions of the zones of the forward sensor, row by row from above, from the left."""


class Ranger:
    """Measures distances to the obstacles of a world; the virtual ones are not there to be seen."""

    def __init__(self, world: World) -> None:
        self._obstacles = world.obstacles
        walls = [
            [*start, *end, *obstacle.height]
            for obstacle in world.obstacles
            for polygon in obstacle.polygons
            for start, end in zip(polygon, (*polygon[1:], polygon[0]), strict=True)
        ]
        self._walls = np.array(walls, float).reshape(-1, 6)

    def measure(self, positions: Array, directions: Array) -> Array:
        """Return the distances along rays, mm; `NO_ECHO` of nothing within 4 m.

        Args:
            positions: (R, 3) where the rays begin, m.
            directions: (R, 3) along them, of any length.

        Returns:
            (R,)

        Example:
            >>> from star_core import Fence
            >>> room = World("room", Fence((-2, -2, 0), (2, 2, 2)))
            >>> Ranger(room).measure(np.array([[0, 0, 0.5]]), np.array([[0, 0, -1.0]]))
            array([500.])
        """
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            nearest = np.fmin.reduce(
                [self._to_walls(positions, unit), *self._to_faces(positions, unit)]
            )
        in_range = nearest <= MAX_RANGE
        rounded = np.floor(1000 * np.where(in_range, nearest, 0.0) + 0.5)
        return np.where(in_range, rounded, NO_ECHO)

    def _to_walls(self, positions: Array, unit: Array) -> Array:
        """Return the distances to the upright faces: (R,) m, inf where a ray meets none."""
        if not len(self._walls):
            return np.full(len(positions), np.inf)
        x, y, z = positions.T[:, :, None]
        u, v, w = unit.T[:, :, None]
        from_x, from_y, to_x, to_y, bottom, top = self._walls.T
        along_x, along_y = to_x - from_x, to_y - from_y
        across = u * along_y - v * along_x  # (R, E), of ray and edge
        distance = ((from_x - x) * along_y - (from_y - y) * along_x) / across
        share = ((from_x - x) * v - (from_y - y) * u) / across
        height = z + distance * w
        meets = (distance >= 0) & (share >= 0) & (share <= 1) & (height >= bottom) & (height <= top)
        distances: Array = np.where(meets, distance, np.inf).min(axis=1)
        return distances

    def _to_faces(self, positions: Array, unit: Array) -> list[Array]:
        """Return the distances to the floor, and to bottom and top of each obstacle: (R,) m."""
        floor = -positions[:, 2] / unit[:, 2]
        distances = [np.where(unit[:, 2] < 0, floor, np.inf)]
        if self._obstacles:
            import shapely

            for obstacle in self._obstacles:
                pieces = [shapely.Polygon(polygon) for polygon in obstacle.polygons]
                for height in obstacle.height:
                    distance = (height - positions[:, 2]) / unit[:, 2]
                    meets = np.isfinite(distance) & (distance >= 0)
                    at = positions + np.where(meets, distance, 0.0)[:, None] * unit
                    inside = np.any(
                        [shapely.contains_xy(piece, at[:, 0], at[:, 1]) for piece in pieces],
                        axis=0,
                    )
                    distances.append(np.where(meets & inside, distance, np.inf))
        return distances


def seen_along(ranger: Ranger, drone: Any, directions: Array) -> Array:
    """Return the distances from a drone along (R, 3) directions in its body: (R,) mm."""
    rotation = rotation_from_quaternion(tuple(drone["attitude"].tolist()))
    positions = np.broadcast_to(drone["position"], (len(directions), 3))
    return ranger.measure(positions, directions @ rotation.T)
