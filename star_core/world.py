"""The world a mission flies in: geofence, obstacles and tags, as plain numbers.

Nothing here imports numpy, so that ``star check`` stays quick.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TypeAlias

from star_core.quaternion import Point, Quaternion

Corner: TypeAlias = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Fence:
    """A box in the map frame that agents must stay in.

    Attributes:
        low: Least x, y and z, m.
        high: Greatest x, y and z, m.
    """

    low: Point
    high: Point

    def contains(self, point: Point) -> bool:
        """Whether `point` (map frame, m) is inside or on the fence.

        >>> Fence((-1, -1, 0), (1, 1, 2)).contains((0.0, 0.5, 3.0))
        False
        """
        return all(
            low <= value <= high
            for low, value, high in zip(self.low, point, self.high, strict=True)
        )

    def distance(self, point: Point) -> float:
        """Return how far `point` (map frame, m) is outside the fence, m; 0 inside.

        >>> Fence((-1, -1, 0), (1, 1, 2)).distance((4.0, 0.0, 6.0))
        5.0
        """
        return math.hypot(
            *(
                max(low - value, value - high, 0.0)
                for low, value, high in zip(self.low, point, self.high, strict=True)
            )
        )


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An upright prism, or several that make one thing.

    Attributes:
        name: As the world file calls it.
        polygons: Corners of each piece in the map's x-y plane, m; a piece may be concave.
        height: z of its foot and of its top, m.
    """

    name: str
    polygons: tuple[tuple[Corner, ...], ...]
    height: tuple[float, float]

    def contains(self, point: Point) -> bool:
        """Whether `point` (map frame, m) is inside.

        >>> pillar = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))
        >>> pillar.contains((0.5, 0.5, 1.0)), pillar.contains((0.5, 0.5, 2.5))
        (True, False)
        """
        foot, top = self.height
        return foot <= point[2] <= top and any(
            _inside(point[0], point[1], polygon) for polygon in self.polygons
        )


@dataclass(frozen=True, slots=True)
class Tag:
    """An AprilTag of family 36h11.

    Attributes:
        id: Its number, 0 to 586.
        size: Edge of its black square, m.
        position: Its centre, map frame, m.
        rotation: From the tag's frame to the map. As one reads the tag, x points right and y up;
            z points out of the paper.
        of: The landmark or target that it belongs to.
    """

    id: int
    size: float
    position: Point
    rotation: Quaternion
    of: str


@dataclass(frozen=True, slots=True)
class World:
    """Where a mission flies.

    Attributes:
        name: For records.
        fence: The geofence.
        obstacles: What to stay clear of.
        landmarks: Tags whose places are known: what localizers look for.
        targets: Tags to be found. Where they are is for simulators only.
    """

    name: str
    fence: Fence
    obstacles: tuple[Obstacle, ...] = field(default=())
    landmarks: tuple[Tag, ...] = field(default=())
    targets: tuple[Tag, ...] = field(default=())

    def fault(self, point: Point) -> str | None:
        """Say why no agent can be at `point` (map frame, m), or return None if one can."""
        if not self.fence.contains(point):
            low, high = self.fence.low, self.fence.high
            return f"{_show(point)} is outside the fence, from {_show(low)} to {_show(high)}"
        for obstacle in self.obstacles:
            if obstacle.contains(point):
                return f"{_show(point)} is inside obstacle {obstacle.name!r}"
        return None


def wall(points: Iterable[Corner], thickness: float) -> tuple[tuple[Corner, ...], ...]:
    """Return one rectangle for each stretch of a wall along `points`.

    Each rectangle reaches half a thickness beyond the ends of its stretch, so that corners close.

    >>> wall([(0, 0), (2, 0)], 0.2)
    (((-0.1, -0.1), (2.1, -0.1), (2.1, 0.1), (-0.1, 0.1)),)
    """
    line = list(points)
    half = thickness / 2
    pieces = []
    for (ax, ay), (bx, by) in pairwise(line):
        length = math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / length * half, (by - ay) / length * half  # along the wall
        pieces.append(
            (
                (ax - ux + uy, ay - uy - ux),
                (bx + ux + uy, by + uy - ux),
                (bx + ux - uy, by + uy + ux),
                (ax - ux - uy, ay - uy + ux),
            )
        )
    return tuple(pieces)


def _inside(x: float, y: float, polygon: tuple[Corner, ...]) -> bool:
    """Whether a point is inside a polygon, by counting crossings of a ray towards +x."""
    odd = False
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            odd = not odd
    return odd


def _show(point: Point) -> str:
    return "[" + ", ".join(f"{value:g}" for value in point) + "]"
