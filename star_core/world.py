"""The world a mission flies in: geofence, obstacles and tags, as plain numbers.

Nothing here imports numpy, so that ``star check`` stays quick.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, TypeAlias

from star_core.rotations import Point, Quaternion

CONTACT_RADIUS: Final = 0.06
"""Half a Crazyflie's span with propellers, m: two drones nearer than twice this collide, and one
nearer than this to an obstacle hits it."""

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
        boxes: Least x and y, and greatest x and y, of each piece, m.
    """

    name: str
    polygons: tuple[tuple[Corner, ...], ...]
    height: tuple[float, float]
    boxes: tuple[tuple[Corner, Corner], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        axes = [tuple(zip(*polygon, strict=True)) for polygon in self.polygons]
        boxes = tuple(((min(x), min(y)), (max(x), max(y))) for x, y in axes)
        object.__setattr__(self, "boxes", boxes)

    def is_near(self, point: Point, beside: float, above: float) -> bool:
        """Return whether `point` (map frame, m) is near a box around one of its pieces.

        It is a quick test before a longer one.

        Args:
            point: m.
            beside: Distance beside the box that is near, m.
            above: Distance above and below the box that is near, m.
        """
        x, y, z = point
        foot, top = self.height
        return foot - above <= z <= top + above and any(
            left - beside <= x <= right + beside and bottom - beside <= y <= back + beside
            for (left, bottom), (right, back) in self.boxes
        )

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

    def distance(self, low: Point, high: float) -> float:
        """Return how far the upright line from `low` (map frame, m) to z `high` is from it, m.

        0 where they meet. With `high` at the height of `low`, or below, it is that of a point.

        >>> shelf = Obstacle("shelf", (((0, 0), (1, 0), (1, 1), (0, 1)),), (1, 2))
        >>> shelf.distance((4.0, 5.0, 0.0), 1.5), shelf.distance((0.5, 0.5, 0.0), 0.75)
        (5.0, 0.25)
        """
        x, y, z = low
        foot, top = self.height
        beside = min(_away(x, y, polygon) for polygon in self.polygons)
        return math.hypot(beside, max(foot - max(high, z), z - top, 0.0))

    def gaps(self, point: Point) -> tuple[float, float]:
        """Return how far `point` (map frame, m) is beside it, and above or below it, m.

        >>> pillar = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))
        >>> pillar.gaps((1.5, 0.5, 1.0)), pillar.gaps((0.5, 0.5, 2.25))
        ((0.5, 0.0), (0.0, 0.25))
        """
        x, y, z = point
        foot, top = self.height
        beside = min(_away(x, y, polygon) for polygon in self.polygons)
        return beside, max(foot - z, z - top, 0.0)

    def touched(self, low: Point, high: float) -> bool:
        """Whether a drone touches it that is on the upright line from `low` to z `high`.

        It does where its middle is nearer than `CONTACT_RADIUS`.
        """
        x, y, z = low
        nearest = x, y, min(max(z, self.height[0]), max(high, z))  # of the line in height
        near = self.is_near(nearest, CONTACT_RADIUS, CONTACT_RADIUS)
        return near and self.distance(low, high) < CONTACT_RADIUS


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
        """Return why no agent can be at `point` (map frame, m), or None if one can.

        It must be inside the fence, and farther than an agent's radius from every obstacle.
        """
        if not self.fence.contains(point):
            low, high = self.fence.low, self.fence.high
            return f"{_show(point)} is outside the fence, from {_show(low)} to {_show(high)}"
        for obstacle in self.obstacles:
            if obstacle.is_near(point, 0.0, 0.0) and obstacle.contains(point):
                return f"{_show(point)} is inside obstacle {obstacle.name!r}"
        return self.contact_fault(point)

    def contact_fault(self, point: Point) -> str | None:
        """Say which obstacle a drone at `point` (map frame, m) touches, or return None if none."""
        for obstacle in self.obstacles:
            if obstacle.touched(point, point[2]):
                away = obstacle.distance(point, point[2])
                return (
                    f"{_show(point)} is {away:.2g} m from obstacle {obstacle.name!r}, "
                    f"expected at least the radius of a drone: {CONTACT_RADIUS:g} m"
                )
        return None

    def overhead(self, point: Point, height: float) -> Obstacle | None:
        """Return the lowest obstacle that a drone touches which climbs from `point` to z `height`.

        Args:
            point: Where the climb begins, map frame, m.
            height: Where it ends, m.
        """
        touched = [obstacle for obstacle in self.obstacles if obstacle.touched(point, height)]
        return min(touched, key=lambda obstacle: obstacle.height[0], default=None)


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


def _away(x: float, y: float, polygon: tuple[Corner, ...]) -> float:
    """How far a point is from a polygon in the plane, m; 0 inside."""
    if _inside(x, y, polygon):
        return 0.0
    edges = zip(polygon, polygon[1:] + polygon[:1], strict=True)
    return min(_from_edge(x, y, a, b) for a, b in edges)


def _from_edge(x: float, y: float, a: Corner, b: Corner) -> float:
    """How far a point is from the stretch between two corners, m."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    along = ((x - a[0]) * dx + (y - a[1]) * dy) / square if square > 0 else 0.0
    share = min(max(along, 0.0), 1.0)
    return math.hypot(x - a[0] - share * dx, y - a[1] - share * dy)


def _show(point: Point) -> str:
    return "[" + ", ".join(f"{value:g}" for value in point) + "]"
