"""What of the floor a camera makes out from a height."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from star_core import Camera, Scene

LOOKS: Final = 3
"""Images in which a tag must be made out: so many the core asks for before a target is found."""

SHARP: Final = 2.0
"""px a module of a tag must be wide; the simulator finds tags from 1.65 px, rendered ones too."""

MODULES: Final = 8  # of a tag's black square of family 36h11, side by side
BORDER: Final = 3.0  # px at the edge of an image in which detectors take no corner
TILT: Final = math.radians(3.0)
"""By how much a drone that flies slowly may lean, either way: so much of the image is left out."""

SIZE: Final = 0.168
"""Edge of a tag's black square if the world names no target, m: that of one on an A4 sheet."""

FINE: Final = 0.05  # m, the cells that a swath is measured in


class View(NamedTuple):
    """The part of the floor in which a level agent's camera makes out a tag that lies there.

    Attributes:
        eye: Where the camera is, body frame turned level, z above the floor, m.
        points: Middles of the cells of that part, body frame turned level, m.
        cell: Edge of a cell, m.
    """

    eye: tuple[float, float, float]
    points: tuple[tuple[float, float], ...]
    cell: float

    @property
    def reach(self) -> float:
        """Distance of the farthest point, m."""
        return max((math.hypot(x, y) for x, y in self.points), default=0.0)

    @property
    def near(self) -> float:
        """Least distance ahead, on the agent's own line, m."""
        return min((x for x, y in self.points if abs(y) <= self.cell), default=0.0)

    @property
    def far(self) -> float:
        """Greatest distance ahead, on the agent's own line, m."""
        return max((x for x, y in self.points if abs(y) <= self.cell), default=0.0)

    def shrunk(self) -> View:
        """Return the cells that have all eight neighbours in view; all of them if none has."""
        there = {(round(x / self.cell), round(y / self.cell)) for x, y in self.points}
        inner = tuple(
            (x, y)
            for x, y in self.points
            if all(
                (round(x / self.cell) + i, round(y / self.cell) + j) in there
                for i in (-1, 0, 1)
                for j in (-1, 0, 1)
            )
        )
        return self._replace(points=inner or self.points)


@cache
def view(camera: Camera, height: float, size: float, cell: float) -> View:
    """Return what a camera makes out from a height above a floor at z = 0.

    A tag is made out where it lies wholly within the image with `BORDER` and `TILT` to spare, and
    its modules are `SHARP` px wide across its longest side, by its slant and its distance.

    Args:
        camera: On the agent, which is level.
        height: Of the agent, m.
        size: Edge of the tag's black square, m.
        cell: Edge of the cells that the floor is cut into, m.
    """
    import numpy as np

    from star_core import CameraModel

    model = CameraModel(camera)
    x, y, z = camera.position
    eye = (x, y, z + height)
    focal = min(camera.matrix[:2])
    far = math.sqrt(max(0.0, focal * size * eye[2] / (MODULES * SHARP)))  # m, from slant and size
    steps = math.ceil((far + math.hypot(x, y)) / cell)
    cells = np.mgrid[-steps : steps + 1, -steps : steps + 1].reshape(2, -1).T * cell
    offset = np.column_stack([cells, np.zeros(len(cells))]) - eye
    ahead = offset @ model.mounting.rotation
    near = (np.linalg.norm(offset, axis=1) <= far) & (ahead[:, 2] > 0)
    cells, ahead = cells[near], ahead[near]
    border = BORDER + max(camera.matrix[:2]) * (
        math.tan(TILT) + size * math.sqrt(0.5) / ahead[:, 2]
    )
    return View(eye, tuple(map(tuple, cells[model.sees(ahead, border)].tolist())), cell)


def swath(seen: View, speed: float, rate: float) -> float:
    """Return how wide a strip is of which an agent that flies ahead misses nothing, m.

    A tag of the strip stays in view for `LOOKS` images and one more; the strip's middle is the
    agent's line. It is 0 if there is no such strip.

    Args:
        seen: What the camera makes out.
        speed: Of the agent, m/s.
        rate: Of the camera, images a second.
    """
    depth: dict[int, int] = {}
    for _, y in seen.points:
        row = round(y / seen.cell)
        depth[row] = depth.get(row, 0) + 1
    enough = (LOOKS + 1) * speed / rate
    half = 0
    while all(depth.get(row, 0) * seen.cell >= enough for row in (half, -half)):
        half += 1
    return max(0, 2 * half - 1) * seen.cell


def smallest_target(scene: Scene) -> float:
    """Return the edge of the smallest tag that is to be found, m."""
    return min((tag.size for tag in scene.world.targets), default=SIZE)


def swaths(
    scene: Scene, rows: Sequence[int], height: float, speed: float
) -> Iterator[tuple[int, float]]:
    """Yield each agent that carries a camera with its `swath`, m."""
    size = smallest_target(scene)
    for row in rows:
        camera = scene.agents[row].camera
        if camera is not None:
            yield row, swath(view(camera, height, size, FINE), speed, camera.rate)
