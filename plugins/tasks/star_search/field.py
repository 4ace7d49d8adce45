"""What a search knows of where it searches: the area, what was seen of it, and where one can be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import shapely
from shapely import Point, Polygon
from shapely.ops import nearest_points

from star_core import Array, Estimate, Goals, Mask, Scene, footprint
from star_search.area import Area, corners
from star_search.chart import Chart
from star_search.pattern import Aim
from star_search.view import smallest_target, swaths, view

CELL: Final = 0.1  # m
MOST_CELLS: Final = 20_000
"""Cells of the area at most; in a larger one they are larger."""

OVERLAP: Final = 0.9
"""Of the strip that a scout sees: the distance of lanes, for it is off its lane at times."""

BLURRED: Final = 1.0
"""rad/s; turning faster smears an image by more than a tag's module: 1.8 px in 10 ms at 180 px."""


class Field:
    """What a search knows of where it searches.

    Args:
        scene: The mission's scene.
        rows: The agents that search; each carries a camera. Others that carry one may take over.
        area: As the mission gives it.
        height: Of the search, m.
        speed: Of the search, m/s; the scene's limit at most.
        swath: Distance between lanes, m; None for what the cameras see.
        clearance: Distance of goals from obstacles and the fence, m.

    Attributes:
        scene: The mission's scene.
        rows: The agents that search at first.
        height: Of the search, m.
        speed: Of the search, m/s.
        swath: Distance between lanes, m.
        area: What is to be seen, map frame, m.
        parts: Where agents may be at that height, map frame, m: one polygon for each part from
            which no other can be reached at that height.
        views: What each agent with a camera sees, in points so dense that no cell between is
            missed.
        outlooks: What each of them is sure to see though it is a cell off.
        chart: What they saw.
    """

    def __init__(
        self,
        scene: Scene,
        rows: tuple[int, ...],
        *,
        area: Area | None,
        height: float,
        speed: float,
        swath: float | None,
        clearance: float,
    ) -> None:
        self.scene = scene
        self.rows = rows
        self.height = height
        self.speed = min(speed, scene.limits.speed)
        self.area = Polygon(corners(scene, area))
        cell = max(CELL, math.sqrt(self.area.area / MOST_CELLS))
        size = smallest_target(scene)
        cameras = {row: one.camera for row, one in enumerate(scene.agents) if one.camera}
        self.views = {row: view(one, height, size, cell / 2) for row, one in cameras.items()}
        self.outlooks = {
            row: view(one, height, size, cell).shrunk() for row, one in cameras.items()
        }
        seen = min(width for _, width in swaths(scene, rows, height, self.speed))
        self.swath = swath or OVERLAP * seen
        self.parts = _free(scene, height, clearance)
        reach = max(one.reach for one in self.views.values())
        low, high = scene.world.fence.low, scene.world.fence.high
        floor = shapely.box(*low[:2], *high[:2]).buffer(-size / 2, join_style="mitre")
        self.chart = Chart(
            self.area.intersection(floor),
            scene.world.obstacles,
            tuple(cameras),
            cell=cell,
            room=reach + cell,
            rim=size / 2,
        )
        self._due = dict.fromkeys(cameras, -math.inf)  # s, when each looks next
        self._yaw: dict[int, tuple[float, float]] = {}  # s and rad, at each agent's last tick

    def look(self, estimate: Estimate, rows: tuple[int, ...]) -> None:
        """Take in what some agents see now, at the rate of their cameras."""
        for row in rows:
            yaw = float(estimate.yaw[row])
            before, was = self._yaw.get(row, (-math.inf, yaw))
            self._yaw[row] = estimate.time, yaw
            turning = abs(math.remainder(yaw - was, math.tau)) / max(estimate.time - before, 1e-9)
            if estimate.time < self._due[row] or turning > BLURRED:
                continue
            camera = self.scene.agents[row].camera
            self._due[row] = estimate.time + (1 / camera.rate if camera else math.inf) - 1e-6
            self.chart.look(row, self.views[row], np.array([*estimate.position[row, :2], yaw]))

    def part_of(self, position: Array) -> int:
        """Return which part an agent at a position is in, or is nearest to; -1 without any."""
        if not self.parts:
            return -1
        return int(np.argmin(shapely.distance(self.parts, Point(position[:2]))))

    def nearest(
        self, wanted: Array, here: Array, taken: Sequence[Array], apart: float
    ) -> tuple[float, float]:
        """Return the place nearest to another where an agent may be, m.

        Args:
            wanted: (2,) where it should be, m.
            here: (3,) where the agent is, m; it stays in that part of the field.
            taken: (2,) positions taken by other agents, m.
            apart: How far to stay away from those, m.
        """
        part = self.part_of(here)
        if part < 0:
            return float(here[0]), float(here[1])
        others = [Point(place).buffer(apart) for place in taken]
        room = self.parts[part].difference(shapely.union_all(others))
        if room.is_empty:
            room = self.parts[part]
        place = nearest_points(room, Point(wanted))[0]
        return float(place.x), float(place.y)

    def goals(self, aims: Mapping[int, Aim]) -> Goals:
        """Return goals for the whole swarm, active for the agents that have an aim."""
        n = len(self.scene.agents)
        position, yaw = np.zeros((n, 3)), np.zeros(n)
        active: Mask = np.zeros(n, np.bool_)
        for row, aim in aims.items():
            position[row] = aim.x, aim.y, self.height
            yaw[row] = aim.yaw
            active[row] = True
        return Goals(position, np.zeros((n, 3)), yaw, np.full(n, self.speed), active)


def _free(scene: Scene, height: float, clearance: float) -> list[Polygon]:
    """Where agents may be at a height."""
    low, high = scene.world.fence.low, scene.world.fence.high
    inside = shapely.box(*low[:2], *high[:2]).buffer(-clearance, join_style="mitre")
    filled = footprint(
        scene.world.obstacles, height - clearance, height + max(clearance, 1e-6), clearance
    )
    free = inside.difference(filled)
    return [
        part for part in shapely.get_parts(free) if isinstance(part, Polygon) and not part.is_empty
    ]
