"""Sightings of targets in a rehearsal: what the cameras of its agents resolve."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core import Array, Mask, Obstacle, Scene, Sightings
from star_core.toolkit import CameraModel, rotation_from_quaternion, square_corners

BORDER: Final = 3.0  # px, within which detectors take no corner
MODULES: Final = 8  # across the black square of a tag of family 36h11
MIN_MODULE: Final = 1.65  # px, as the detectors of `sim` need
VARIANCE: Final = 1e-4  # m²: a rehearsal has no errors, but a position has some


class Lookout:
    """The cameras of a mission's agents, and the targets that they look for.

    An agent sees a target at the rate of its camera if the whole tag is in the image, its modules
    are wide enough and no obstacle is in between, with the agent level and its position exact.
    """

    def __init__(self, scene: Scene) -> None:
        tags = scene.world.targets
        self._obstacles = scene.world.obstacles
        self._id = np.array([tag.id for tag in tags], np.int64)
        self._center = np.array([tag.position for tag in tags]).reshape(-1, 3)
        frames = [rotation_from_quaternion(tag.rotation) for tag in tags]
        self._normal = np.array([frame[:, 2] for frame in frames]).reshape(-1, 3)
        self._corners = np.array(
            [
                center + square_corners(tag.size) @ frame.T
                for tag, center, frame in zip(tags, self._center, frames, strict=True)
            ]
        ).reshape(-1, 4, 3)
        cameras = {row: agent.camera for row, agent in enumerate(scene.agents) if agent.camera}
        self._models = {row: CameraModel(camera) for row, camera in cameras.items()}
        self._due = dict.fromkeys(self._models, 0.0)  # s, of the next image

    @property
    def watches(self) -> bool:
        """Whether any agent can ever see a target."""
        return len(self._id) > 0 and len(self._models) > 0

    def look(self, time: float, position: Array, yaw: Array, flies: Mask) -> Sightings:
        """Return what agents see now.

        Args:
            time: Mission time, s.
            position: (N, 3) in the map, m.
            yaw: (N,) rad.
            flies: (N,) agents whose cameras take images.
        """
        agents, targets = [], []
        for row, model in self._models.items() if self.watches else ():
            if flies[row] and time >= self._due[row]:
                self._due[row] = time + 1 / model.camera.rate - 1e-6
                visible = self._visible(model, position[row], float(yaw[row]))
                agents += [row] * len(visible)
                targets += visible
        n = len(agents)
        return Sightings(
            agent=np.array(agents, np.int64),
            tag=self._id[targets],
            time=np.full(n, time),
            position=self._center[targets],
            yaw=np.zeros(n),
            covariance=np.tile(VARIANCE * np.eye(3), (n, 1, 1)),
        )

    def _visible(self, model: CameraModel, position: Array, yaw: float) -> list[int]:
        """Return the targets that an agent sees."""
        cos, sin = np.cos(yaw), np.sin(yaw)
        body = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        camera = position + body @ model.mounting.position
        points = (self._corners - camera) @ (body @ model.mounting.rotation)
        facing = ((camera - self._center) * self._normal).sum(axis=1) > 0.0
        near = np.flatnonzero(facing & (points[..., 2] > 0.0).all(axis=1))
        inside = near[model.sees(points[near], BORDER).all(axis=1)]
        wide = inside[_module(model.project(points[inside])) >= MIN_MODULE]
        return [k for k in wide.tolist() if not self._hidden(camera, self._center[k])]

    def _hidden(self, camera: Array, target: Array) -> bool:
        return any(_between(camera, target, obstacle) for obstacle in self._obstacles)


def _module(pixels: Array) -> Array:
    """Return the width of modules across each tag's longest side, px."""
    sides = np.roll(pixels, -1, axis=1) - pixels
    longest = np.linalg.norm(sides, axis=2).max(axis=1, initial=1e-9)
    a, b = pixels[:, 2] - pixels[:, 0], pixels[:, 3] - pixels[:, 1]  # the diagonals
    width: Array = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / (longest * MODULES)
    return width


def _between(start: Array, end: Array, obstacle: Obstacle) -> bool:
    """Return whether an obstacle crosses the line between two points."""
    from shapely import LineString, Polygon

    bottom, top = obstacle.height
    low, high = sorted((start[2], end[2]))
    if high <= bottom or low >= top:
        return False
    rise = end[2] - start[2]
    shares = (
        [0.0, 1.0] if rise == 0 else np.clip((np.array(obstacle.height) - start[2]) / rise, 0, 1)
    )
    line = LineString([start[:2] + share * (end - start)[:2] for share in shares])
    return any(line.intersects(Polygon(outline)) for outline in obstacle.polygons)
