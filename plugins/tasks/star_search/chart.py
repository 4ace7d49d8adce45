"""Which cells of the floor were seen, and which can be seen from where."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from star_core import Array, Mask, Obstacle, Rows, footprint
from star_search.view import LOOKS, View

PAD: Final = 0.5
"""Of a cell's diagonal: by how much obstacles are thickened that hide what is behind them."""

FLAT: Final = 1e-3  # m above the floor, where obstacles stand on it
AT_ONCE: Final = 64  # poses that are worked on together: more of them fall out of the cache


class Chart:
    """A grid of square cells over the area, of which each was seen or was not.

    A cell counts as seen by an agent that had its middle in view at `LOOKS` looks, not hidden by
    an obstacle. Cells are numbered; the number `nowhere` stands for all that is beyond the grid.

    Args:
        area: What is to be seen, map frame, m; it may have holes.
        obstacles: What hides the floor, and covers it.
        rows: The agents that look.
        cell: Edge of a cell, m.
        room: How far beyond the area agents may be that see it, m.
        rim: How near to an obstacle the middle of a tag cannot lie, m.

    Attributes:
        cell: Edge of a cell, m.
        nowhere: The number of cells.
        middle: (C, 2) of each cell, map frame, m.
        wanted: (C + 1,) cells that are to be seen.
        seen: (C + 1,) cells that were.
    """

    def __init__(
        self,
        area: BaseGeometry,
        obstacles: Sequence[Obstacle],
        rows: Sequence[int],
        *,
        cell: float,
        room: float,
        rim: float,
    ) -> None:
        west, south, east, north = area.bounds
        self.cell = cell
        self._low = np.array([west - room, south - room])
        self._shape = (
            math.ceil((east - west + 2 * room) / cell),
            math.ceil((north - south + 2 * room) / cell),
        )
        x, y = (
            low + cell * (np.arange(n) + 0.5)
            for low, n in zip(self._low.tolist(), self._shape, strict=True)
        )
        self.middle: Array = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        self.nowhere = len(self.middle)
        standing = [one for one in obstacles if one.height[0] <= 0 < one.height[1]]
        self.wanted = self._covered(area.difference(footprint(standing, 0.0, FLAT, rim)))
        self.seen = np.zeros(self.nowhere + 1, np.bool_)
        self._looks = {row: np.zeros(self.nowhere + 1, np.uint8) for row in rows}
        self._hides = self._rasters(obstacles)

    @property
    def left(self) -> Mask:
        """(C + 1,) cells that are still to be seen."""
        return self.wanted & ~self.seen

    @property
    def covered(self) -> float:
        """Share of the cells that are to be seen that were."""
        return 1.0 - int(self.left.sum()) / max(1, int(self.wanted.sum()))

    def look(self, row: int, view: View, pose: Array) -> None:
        """Take in what an agent sees from a pose (x, y, yaw)."""
        cells = self.visible(view, pose[None])[0]
        looks = self._looks[row]
        looks[cells] = np.minimum(looks[cells] + 1, LOOKS)
        self.seen[cells] |= looks[cells] >= LOOKS
        self.seen[self.nowhere] = False

    def visible(self, view: View, pose: Array) -> Rows:
        """Return the cells in view from each pose, `nowhere` where there is none.

        A straight line of sight leads from the camera down to each cell. It is looked at in steps
        of half a cell, but not within a cell of its end: what stands there hides nothing yet.

        Args:
            view: Of the camera; its height is that of the poses.
            pose: (V, 3) x, y and yaw, map frame, m and rad.

        Returns:
            (V, M) numbers of cells, a column for each point of the view.
        """
        points = np.array(view.points).reshape(-1, 2)
        parts = [
            self._visible(view.eye, points, pose[first : first + AT_ONCE])
            for first in range(0, len(pose), AT_ONCE)
        ]
        return np.concatenate([np.zeros((0, len(points)), np.int64), *parts])

    def _visible(self, eye: tuple[float, float, float], points: Array, pose: Array) -> Rows:
        turn = np.exp(1j * pose[:, 2])[:, None]  # (V, 1)
        here = (pose[:, 0] + 1j * pose[:, 1])[:, None]
        at = here + turn * (points[:, 0] + 1j * points[:, 1])  # (V, M)
        camera = here + turn * complex(eye[0], eye[1])
        cells = self._number(at)
        away = at - camera
        distance = np.abs(away)
        steps = math.ceil(2 * float(distance.max(initial=0.0)) / self.cell)
        share = (np.arange(steps) + 0.5) / max(1, steps)  # (S,)
        height = eye[2] * (1 - share)
        for hiding, foot, top in self._hides:
            some = share[(foot < height) & (height < top)][:, None, None]
            on_way = self._number(camera + some * away)  # (S, V, M)
            hidden = hiding[on_way] & (some * distance < distance - self.cell)
            cells[hidden.any(axis=0)] = self.nowhere
        return cells

    def _number(self, at: np.ndarray) -> Rows:
        """The cells that complex positions lie in."""
        x = np.floor((at.real - self._low[0]) / self.cell).astype(np.int64)
        y = np.floor((at.imag - self._low[1]) / self.cell).astype(np.int64)
        inside = (x >= 0) & (y >= 0) & (x < self._shape[0]) & (y < self._shape[1])
        number: Rows = np.where(inside, x * self._shape[1] + y, self.nowhere)
        return number

    def _covered(self, shape: BaseGeometry) -> Mask:
        """(C + 1,) cells whose middle lies in a shape."""
        shapely.prepare(shape)
        inside = shapely.contains_xy(shape, self.middle[:, 0], self.middle[:, 1])
        return np.append(inside, [False])

    def _rasters(self, obstacles: Sequence[Obstacle]) -> list[tuple[Mask, float, float]]:
        """The cells that obstacles of one foot and one top stand in, with both, m."""
        alike: dict[tuple[float, float], list[Obstacle]] = {}
        for obstacle in obstacles:
            alike.setdefault(obstacle.height, []).append(obstacle)
        pad = PAD * math.sqrt(2) * self.cell
        return [
            (self._covered(footprint(some, foot, top, pad)), foot, top)
            for (foot, top), some in alike.items()
        ]

    def beside(self, cells: Mask) -> Mask:
        """(C + 1,) which cells have a neighbour on one of their sides among `cells`."""
        grid = np.pad(cells[:-1].reshape(self._shape), 1)
        near = grid[:-2, 1:-1] | grid[2:, 1:-1] | grid[1:-1, :-2] | grid[1:-1, 2:]
        return np.append(near.reshape(-1), [False])
