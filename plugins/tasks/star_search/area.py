"""The area to search, and the width of it that a camera sees."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from star_core import Problem
from star_core.toolkit import TAG_SIZE, outline_fault

if TYPE_CHECKING:
    from star_core import Camera, Scene


Corner: TypeAlias = tuple[float, float]
Area: TypeAlias = Sequence[Sequence[float]] | Mapping[str, Sequence[float]]


def area_corners(scene: Scene, area: Area | None) -> tuple[Corner, ...]:
    """Return the corners of the area, m: of a polygon, of a box, or of the fence if None."""
    if area is None:
        fence = scene.world.fence
        area = {"low": fence.low[:2], "high": fence.high[:2]}
    if isinstance(area, Mapping):
        (x, y), (u, v) = area["low"], area["high"]
        return ((x, y), (u, y), (u, v), (x, v))
    return tuple((float(x), float(y)) for x, y in area)


def area_problems(scene: Scene, area: Area | None) -> Iterator[Problem]:
    """Check that an area is inside the fence, and that its outline is a polygon."""
    if area is None:
        return
    low, high = scene.world.fence.low, scene.world.fence.high
    named = area.items() if isinstance(area, Mapping) else enumerate(area)
    for key, (x, y) in named:
        if not (low[0] <= x <= high[0] and low[1] <= y <= high[1]):
            yield Problem(
                ("area", key),
                f"[{x:g}, {y:g}] is outside the fence, from [{low[0]:g}, {low[1]:g}] "
                f"to [{high[0]:g}, {high[1]:g}]",
                "outside-geofence",
            )
    if isinstance(area, Mapping):
        (x, y), (u, v) = area["low"], area["high"]
        if not (x < u and y < v):
            message = f"low {area['low']!r} is not below high {area['high']!r} in x and y"
            yield Problem(("area",), message, "out-of-range")
    elif fault := outline_fault(area_corners(scene, area)):
        message = f"{fault}; give the corners in order around the area"
        yield Problem(("area",), message, "invalid-outline")


MIN_IMAGES: Final = 3  # of a tag, which the core requires before a target is found
MIN_MODULE: Final = 2.0  # px: width of a tag's module; the simulator detects tags from 1.65 px
MODULES: Final = 8  # along the edge of a tag's black square, family 36h11
BORDER: Final = 3.0  # px at the edge of an image where detectors accept no corner
MAX_TILT: Final = math.radians(3.0)  # of a slow drone, for which a margin of the image is unused
SWATH_CELL: Final = 0.05  # m, resolution of swaths


class FieldOfView(NamedTuple):
    """Where on the floor a level agent's camera resolves a tag.

    Attributes:
        camera: Position of the camera, leveled body frame, z above the floor, m.
        points: Centers of the cells in which it resolves a tag, leveled body frame, m.
        cell: Edge of a cell, m.
    """

    camera: tuple[float, float, float]
    points: tuple[tuple[float, float], ...]
    cell: float

    @property
    def reach(self) -> float:
        """Distance of the farthest point, m."""
        return max((math.hypot(x, y) for x, y in self.points), default=0.0)

    @property
    def near(self) -> float:
        """Least distance straight ahead, m."""
        return min((x for x, y in self.points if abs(y) <= self.cell), default=0.0)

    @property
    def far(self) -> float:
        """Greatest distance straight ahead, m."""
        return max((x for x, y in self.points if abs(y) <= self.cell), default=0.0)

    def eroded(self) -> FieldOfView:
        """Return the cells with all eight neighbours in view; all cells if there are none."""
        cells = {(round(x / self.cell), round(y / self.cell)) for x, y in self.points}
        inner = tuple(
            (x, y)
            for x, y in self.points
            if all(
                (round(x / self.cell) + i, round(y / self.cell) + j) in cells
                for i in (-1, 0, 1)
                for j in (-1, 0, 1)
            )
        )
        return self._replace(points=inner or self.points)


@cache
def field_of_view(camera: Camera, height: float, size: float, cell: float) -> FieldOfView:
    """Return where a camera resolves tags on the floor, z = 0, from a height.

    A tag is resolved where it is entirely in the image, with `BORDER` and `MAX_TILT` to spare, and
    its modules appear `MIN_MODULE` wide at its slant and distance.

    Args:
        camera: On the agent, which is level.
        height: Height of the agent, m.
        size: Edge of the tag's black square, m.
        cell: Edge of the cells, m.
    """
    import numpy as np

    from star_core.toolkit import CameraModel

    model = CameraModel(camera)
    x, y, z = camera.position
    position = (x, y, z + height)
    focal = min(camera.matrix[:2])
    far = math.sqrt(
        max(0.0, focal * size * position[2] / (MODULES * MIN_MODULE))
    )  # m, from slant and size
    steps = math.ceil((far + math.hypot(x, y)) / cell)
    cells = np.mgrid[-steps : steps + 1, -steps : steps + 1].reshape(2, -1).T * cell
    offset = np.column_stack([cells, np.zeros(len(cells))]) - position
    ahead = offset @ model.mounting.rotation
    near = (np.linalg.norm(offset, axis=1) <= far) & (ahead[:, 2] > 0)
    cells, ahead = cells[near], ahead[near]
    border = BORDER + max(camera.matrix[:2]) * (
        math.tan(MAX_TILT) + size * math.sqrt(0.5) / ahead[:, 2]
    )
    return FieldOfView(position, tuple(map(tuple, cells[model.sees(ahead, border)].tolist())), cell)


def swath(view: FieldOfView, speed: float, rate: float) -> float:
    """Return the width of the strip in which an agent that flies ahead sees every tag, m.

    A tag in the strip stays in view for `MIN_IMAGES` images and one more; the strip is centered on
    the agent's path. It is 0 if there is no such strip.

    Args:
        view: Field of view.
        speed: Speed of the agent, m/s.
        rate: Rate of the camera, images a second.
    """
    depth: dict[int, int] = {}
    for _, y in view.points:
        row = round(y / view.cell)
        depth[row] = depth.get(row, 0) + 1
    enough = (MIN_IMAGES + 1) * speed / rate
    half = 0
    while all(depth.get(row, 0) * view.cell >= enough for row in (half, -half)):
        half += 1
    return max(0, 2 * half - 1) * view.cell


def smallest_target(scene: Scene) -> float:
    """Return the edge of the smallest target tag, m."""
    return min((tag.size for tag in scene.world.targets), default=TAG_SIZE)


def swaths(
    scene: Scene, rows: Sequence[int], height: float, speed: float
) -> Iterator[tuple[int, float]]:
    """Yield each agent with a camera and its `swath`, m."""
    size = smallest_target(scene)
    for row in rows:
        camera = scene.agents[row].camera
        if camera is not None:
            yield row, swath(field_of_view(camera, height, size, SWATH_CELL), speed, camera.rate)
