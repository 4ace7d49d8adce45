"""Coverage map: cells of the floor that were seen, and those visible from a pose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from star_core import Array, Mask, Obstacle, Rows
from star_core.toolkit import footprint
from star_search.area import MIN_IMAGES, FieldOfView

OCCLUSION_PAD: Final = 0.5  # of a cell's diagonal, by which obstacles that hide cells are enlarged
FLOOR_HEIGHT: Final = 1e-3  # m: obstacles that reach lower stand on the floor
BATCH: Final = 64  # poses evaluated together: more of them exceed the processor's cache


class CoverageMap:
    """A grid of square cells over the area, and which of them were seen.

    A cell is seen once its center was in view of one agent in `MIN_IMAGES` images, not hidden by an
    obstacle. Cells are numbered; the number `outside` stands for everything beyond the grid.

    Args:
        area: Area to cover, map frame, m; it may have holes.
        obstacles: Obstacles that hide the floor or stand on it.
        rows: Agents with cameras.
        cell: Edge of a cell, m.
        border: Width of the grid beyond the area, for agents that see it from there, m.
        clearance: Least distance of a tag's center from an obstacle, m.

    Attributes:
        cell: Edge of a cell, m.
        outside: The number of cells.
        center: (C, 2) of each cell, map frame, m.
        required: (C + 1,) cells that are to be seen.
        seen: (C + 1,) cells that were seen.
    """

    def __init__(
        self,
        area: BaseGeometry,
        obstacles: Sequence[Obstacle],
        rows: Sequence[int],
        *,
        cell: float,
        border: float,
        clearance: float,
    ) -> None:
        west, south, east, north = area.bounds
        self.cell = cell
        self._low = np.array([west - border, south - border])
        self._shape = (
            math.ceil((east - west + 2 * border) / cell),
            math.ceil((north - south + 2 * border) / cell),
        )
        x, y = (
            low + cell * (np.arange(n) + 0.5)
            for low, n in zip(self._low.tolist(), self._shape, strict=True)
        )
        self.center: Array = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        self.outside = len(self.center)
        standing = [
            obstacle for obstacle in obstacles if obstacle.height[0] <= 0 < obstacle.height[1]
        ]
        self.required = self._covered(
            area.difference(footprint(standing, 0.0, FLOOR_HEIGHT, clearance))
        )
        self.seen = np.zeros(self.outside + 1, np.bool_)
        self._images = {row: np.zeros(self.outside + 1, np.uint8) for row in rows}
        self._occluders = self._rasterized(obstacles)

    @property
    def unseen(self) -> Mask:
        """(C + 1,) required cells that were not seen."""
        return self.required & ~self.seen

    @property
    def fraction(self) -> float:
        """Share of the required cells that were seen."""
        return 1.0 - int(self.unseen.sum()) / max(1, int(self.required.sum()))

    def observe(self, row: int, view: FieldOfView, pose: Array) -> None:
        """Count an image of an agent from a pose (x, y, yaw)."""
        cells = self.visible(view, pose[None])[0]
        images = self._images[row]
        images[cells] = np.minimum(images[cells] + 1, MIN_IMAGES)
        self.seen[cells] |= images[cells] >= MIN_IMAGES
        self.seen[self.outside] = False

    def visible(self, view: FieldOfView, pose: Array) -> Rows:
        """Return the cells in view from each pose, `outside` for points without a visible cell.

        The line of sight from the camera to each cell is sampled in steps of half a cell, but not
        within a cell of its end: an obstacle there does not hide the cell yet.

        Args:
            view: Field of view of the camera, at the height of the poses.
            pose: (V, 3) x, y and yaw, map frame, m and rad.

        Returns:
            (V, M) numbers of cells, a column for each point of the view.
        """
        points = np.array(view.points).reshape(-1, 2)
        batches = [
            self._visible(view.camera, points, pose[first : first + BATCH])
            for first in range(0, len(pose), BATCH)
        ]
        return np.concatenate([np.zeros((0, len(points)), np.int64), *batches])

    def _visible(self, position: tuple[float, float, float], points: Array, pose: Array) -> Rows:
        rotation = np.exp(1j * pose[:, 2])[:, None]  # (V, 1)
        origin = (pose[:, 0] + 1j * pose[:, 1])[:, None]
        at = origin + rotation * (points[:, 0] + 1j * points[:, 1])  # (V, M)
        camera = origin + rotation * complex(position[0], position[1])
        cells = self._number(at)
        away = at - camera
        distance = np.abs(away)
        steps = math.ceil(2 * float(distance.max(initial=0.0)) / self.cell)
        share = (np.arange(steps) + 0.5) / max(1, steps)  # (S,)
        height = position[2] * (1 - share)
        for hiding, bottom, top in self._occluders:
            some = share[(bottom < height) & (height < top)][:, None, None]
            line_of_sight = self._number(camera + some * away)  # (S, V, M)
            hidden = hiding[line_of_sight] & (some * distance < distance - self.cell)
            cells[hidden.any(axis=0)] = self.outside
        return cells

    def _number(self, at: np.ndarray) -> Rows:
        """The cells of complex positions."""
        x = np.floor((at.real - self._low[0]) / self.cell).astype(np.int64)
        y = np.floor((at.imag - self._low[1]) / self.cell).astype(np.int64)
        inside = (x >= 0) & (y >= 0) & (x < self._shape[0]) & (y < self._shape[1])
        number: Rows = np.where(inside, x * self._shape[1] + y, self.outside)
        return number

    def _covered(self, shape: BaseGeometry) -> Mask:
        """(C + 1,) cells whose center lies in a shape."""
        shapely.prepare(shape)
        inside = shapely.contains_xy(shape, self.center[:, 0], self.center[:, 1])
        return np.append(inside, [False])

    def _rasterized(self, obstacles: Sequence[Obstacle]) -> list[tuple[Mask, float, float]]:
        """The cells of all obstacles with the same bottom and top, with both, m."""
        alike: dict[tuple[float, float], list[Obstacle]] = {}
        for obstacle in obstacles:
            alike.setdefault(obstacle.height, []).append(obstacle)
        pad = OCCLUSION_PAD * math.sqrt(2) * self.cell
        return [
            (self._covered(footprint(some, bottom, top, pad)), bottom, top)
            for (bottom, top), some in alike.items()
        ]

    def adjacent(self, cells: Mask) -> Mask:
        """(C + 1,) cells with one of `cells` on one of their four sides."""
        grid = np.pad(cells[:-1].reshape(self._shape), 1)
        near = grid[:-2, 1:-1] | grid[2:, 1:-1] | grid[1:-1, :-2] | grid[1:-1, 2:]
        return np.append(near.reshape(-1), [False])
