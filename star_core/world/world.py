"""The world of a mission: geofence, obstacles and tags, as plain numbers.

shapely, and numpy with it, is imported when the first distance to an obstacle is computed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Final, TypeAlias

from star_core.world.quaternions import Point, Quaternion

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from shapely import GeometryCollection

CONTACT_RADIUS: Final = 0.06
"""Half a Crazyflie's span with propellers, m: two drones closer than twice this collide, and one
closer than this to an obstacle hits it."""

TAG_SIZE: Final = 0.168
"""Edge of the black square of a tag that is printed to fill an A4 sheet, m; files may omit it."""

TAG_RIM: Final = 1.25
"""Width of a tag with its white rim over that of its black square: ten modules over eight."""

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
        """Return whether `point` (map frame, m) is inside or on the fence.

        >>> Fence((-1, -1, 0), (1, 1, 2)).contains((0.0, 0.5, 3.0))
        False
        """
        return self.distance(point) == 0.0

    def distance(self, point: Point) -> float:
        """Return the distance of `point` (map frame, m) outside the fence, m; 0 inside.

        It is NaN where a coordinate is.

        >>> Fence((-1, -1, 0), (1, 1, 2)).distance((4.0, 0.0, 6.0))
        5.0
        """
        return math.hypot(
            *(
                max(low - value, value - high, 0.0)  # NaN comes first, and stays
                for low, value, high in zip(self.low, point, self.high, strict=True)
            )
        )


@dataclass(frozen=True)
class Obstacle:
    """An upright prism, or several that belong together.

    Attributes:
        name: In the world file.
        polygons: Corners of each piece in the map's x-y plane, m; a piece may be concave.
        height: z of its bottom and of its top, m.
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
        bottom, top = self.height
        return bottom - above <= z <= top + above and any(
            left - beside <= x <= right + beside and front - beside <= y <= back + beside
            for (left, front), (right, back) in self.boxes
        )

    def contains(self, point: Point) -> bool:
        """Return whether `point` (map frame, m) is inside.

        >>> pillar = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))
        >>> pillar.contains((0.5, 0.5, 1.0)), pillar.contains((0.5, 0.5, 2.5))
        (True, False)
        """
        return self.gaps(point) == (0.0, 0.0)

    def distance(self, low: Point, high: float) -> float:
        """Return the distance of the upright line from `low` (map frame, m) to z `high`, m.

        0 where they meet. With `high` at the height of `low`, or below, it is that of a point.

        >>> shelf = Obstacle("shelf", (((0, 0), (1, 0), (1, 1), (0, 1)),), (1, 2))
        >>> shelf.distance((4.0, 5.0, 0.0), 1.5), shelf.distance((0.5, 0.5, 0.0), 0.75)
        (5.0, 0.25)
        """
        beside, _ = self.gaps(low)
        bottom, top = self.height
        return math.hypot(beside, max(bottom - max(high, low[2]), low[2] - top, 0.0))

    def distances(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distances of (N, 3) positions in the map, m, 0 inside: (N,) m.

        >>> import numpy as np
        >>> pillar = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))
        >>> pillar.distances(np.array([[2.0, 0.5, 1.0], [0.5, 0.5, 3.0], [0.5, 0.5, 1.0]]))
        array([1., 1., 0.])
        """
        import numpy as np
        import shapely

        bottom, top = self.height
        above = np.maximum(0.0, np.maximum(bottom - position[:, 2], position[:, 2] - top))
        with np.errstate(invalid="ignore"):  # NaN has the distance inf
            beside = shapely.distance(self._area, shapely.points(position[:, :2]))
        distances: NDArray[np.float64] = np.hypot(beside, above)
        return distances

    def gaps(self, point: Point) -> tuple[float, float]:
        """Return the distances of `point` (map frame, m) beside it, and above or below it, m.

        >>> pillar = Obstacle("pillar", (((0, 0), (1, 0), (1, 1), (0, 1)),), (0, 2))
        >>> pillar.gaps((1.5, 0.5, 1.0)), pillar.gaps((0.5, 0.5, 2.25))
        ((0.5, 0.0), (0.0, 0.25))
        """
        import shapely

        x, y, z = point
        bottom, top = self.height
        return float(self._area.distance(shapely.Point(x, y))), max(bottom - z, z - top, 0.0)

    def touched(self, low: Point, high: float) -> bool:
        """Return whether a drone touches it that is on the upright line from `low` to z `high`.

        It does where its center is closer than `CONTACT_RADIUS`.
        """
        x, y, z = low
        nearest = x, y, min(max(z, self.height[0]), max(high, z))  # of the line in height
        near = self.is_near(nearest, CONTACT_RADIUS, CONTACT_RADIUS)
        return near and self.distance(low, high) < CONTACT_RADIUS

    @cached_property
    def _area(self) -> GeometryCollection:
        """Its pieces in the map's x-y plane, which may overlap."""
        import shapely

        return shapely.GeometryCollection([shapely.Polygon(piece) for piece in self.polygons])


@dataclass(frozen=True, slots=True)
class Tag:
    """An AprilTag of family 36h11.

    Attributes:
        id: Its number, 0 to 586.
        size: Edge of its black square, m.
        position: Its center, map frame, m.
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
class Beacon:
    """A base station or an anchor of a positioning system, whose receivers are on board.

    Attributes:
        name: In the world.
        position: Map frame, m.
        rotation: From its frame to the map: a base station looks along x, and z is up.
    """

    name: str
    position: Point
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class World:
    """The environment of a mission.

    Attributes:
        name: For records.
        fence: The geofence.
        obstacles: To stay clear of.
        virtual: Obstacles that are not there: planners lead around them where they can. Agents may
            start, stand and fly in them.
        base_stations: Of a Lighthouse positioning system.
        anchors: Of a Loco positioning system.
        landmarks: Tags with known poses, for localizers.
        targets: Tags to be found. Their poses are for simulators only.
    """

    name: str
    fence: Fence
    obstacles: tuple[Obstacle, ...] = field(default=())
    landmarks: tuple[Tag, ...] = field(default=())
    targets: tuple[Tag, ...] = field(default=())
    virtual: tuple[Obstacle, ...] = field(default=())
    base_stations: tuple[Beacon, ...] = field(default=())
    anchors: tuple[Beacon, ...] = field(default=())

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
        """Return which obstacle a drone at `point` (map frame, m) touches, or None."""
        for obstacle in self.obstacles:
            if obstacle.touched(point, point[2]):
                away = obstacle.distance(point, point[2])
                return (
                    f"{_show(point)} is {away:.2g} m from obstacle {obstacle.name!r}, "
                    f"expected at least the radius of a drone: {CONTACT_RADIUS:g} m"
                )
        return None

    def overhead(self, point: Point, height: float) -> Obstacle | None:
        """Return the lowest obstacle that a drone touches that climbs from `point` to z `height`.

        Args:
            point: Where the climb begins, map frame, m.
            height: Where it ends, m.
        """
        touched = [obstacle for obstacle in self.obstacles if obstacle.touched(point, height)]
        return min(touched, key=lambda obstacle: obstacle.height[0], default=None)

    def below(self, point: Point) -> Obstacle | None:
        """Return the obstacle whose top is the surface below `point` (map frame, m), if one is."""
        below = [
            obstacle
            for obstacle in self.obstacles
            if obstacle.height[1] <= point[2] + CONTACT_RADIUS
            and obstacle.is_near(point, 0.0, math.inf)
            and obstacle.gaps(point)[0] == 0.0
        ]
        return max(below, key=lambda obstacle: obstacle.height[1], default=None)


def _show(point: Point) -> str:
    return "[" + ", ".join(f"{value:g}" for value in point) + "]"
