"""The search space: the area, the coverage of it, and where agents can be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import shapely
from shapely import Point, Polygon
from shapely.ops import nearest_points

from star_core import Array, Estimate, Goals, Mask, Scene
from star_core.toolkit import footprint
from star_search.area import Area, area_corners, field_of_view, smallest_target, swaths
from star_search.coverage_map import CoverageMap
from star_search.pattern import Waypoint

CELL_SIZE: Final = 0.1  # m
MAX_CELLS: Final = 20_000  # of the area; in a larger one they are larger
SWATH_FACTOR: Final = 0.9  # lane spacing over the width of the visible strip: scouts leave lanes
MAX_YAW_RATE: Final = 1.0
"""rad/s; turning faster smears an image by more than a tag's module: 1.8 px in 10 ms at 180 px."""


class SearchSpace:
    """The area, the coverage of it, and where agents can be.

    Args:
        scene: The mission's scene.
        rows: Agents that search, which all have cameras. Other agents with cameras may replace
            them.
        area: As in the mission.
        height: Height of the search, m.
        speed: Speed limit of the search, m/s; at most the scene's limit.
        lane_spacing: Distance between lanes, m; None for what the cameras see.
        clearance: Distance of goals from obstacles and the fence, m.

    Attributes:
        scene: The mission's scene.
        rows: Agents that search at first.
        height: Height of the search, m.
        speed: Speed limit of the search, m/s.
        lane_spacing: Distance between lanes, m.
        area: Area to cover, map frame, m.
        regions: Where agents may be at that height, map frame, m: connected polygons, between
            which no path leads at that height.
        views: Field of view of each agent with a camera, in points so dense that no cell between
            is missed.
        safe_views: Cells that each of them sees even with a position error of one cell.
        coverage: Cells that they have seen.
    """

    def __init__(
        self,
        scene: Scene,
        rows: tuple[int, ...],
        *,
        area: Area | None = None,
        height: float,
        speed: float,
        lane_spacing: float | None = None,
        clearance: float,
    ) -> None:
        self.scene = scene
        self.rows = rows
        self.height = height
        self.speed = min(speed, scene.limits.speed)
        self.area = Polygon(area_corners(scene, area))
        cell = max(CELL_SIZE, math.sqrt(self.area.area / MAX_CELLS))
        size = smallest_target(scene)
        cameras = {row: agent.camera for row, agent in enumerate(scene.agents) if agent.camera}
        self.views = {
            row: field_of_view(camera, height, size, cell / 2) for row, camera in cameras.items()
        }
        self.safe_views = {
            row: field_of_view(camera, height, size, cell).eroded()
            for row, camera in cameras.items()
        }
        narrowest = min(width for _, width in swaths(scene, rows, height, self.speed))
        self.lane_spacing = lane_spacing or SWATH_FACTOR * narrowest
        self.regions = _free_regions(scene, height, clearance)
        reach = max(view.reach for view in self.views.values())
        low, high = scene.world.fence.low, scene.world.fence.high
        floor = shapely.box(*low[:2], *high[:2]).buffer(-size / 2, join_style="mitre")
        self.coverage = CoverageMap(
            self.area.intersection(floor),
            scene.world.obstacles,
            tuple(cameras),
            cell=cell,
            border=reach + cell,
            clearance=size / 2,
        )
        self._due = dict.fromkeys(cameras, -math.inf)  # s, time of each agent's next image
        self._yaw: dict[int, tuple[float, float]] = {}  # s and rad, at each agent's last tick

    def observe(self, estimate: Estimate, rows: tuple[int, ...]) -> None:
        """Update the coverage with what agents see now, at the rate of their cameras."""
        for row in rows:
            yaw = float(estimate.yaw[row])
            time, previous = self._yaw.get(row, (-math.inf, yaw))
            self._yaw[row] = estimate.time, yaw
            yaw_rate = abs(math.remainder(yaw - previous, math.tau)) / max(
                estimate.time - time, 1e-9
            )
            if estimate.time < self._due[row] or yaw_rate > MAX_YAW_RATE:
                continue
            camera = self.scene.agents[row].camera
            self._due[row] = estimate.time + (1 / camera.rate if camera else math.inf) - 1e-6
            pose = np.array([*estimate.position[row, :2], yaw])
            self.coverage.observe(row, self.views[row], pose)

    def region_of(self, position: Array) -> int:
        """Return the region of a position, or the nearest to it; -1 without any."""
        if not self.regions:
            return -1
        return int(np.argmin(shapely.distance(self.regions, Point(position[:2]))))

    def nearest_free(
        self, target: Array, position: Array, taken: Sequence[Array], spacing: float
    ) -> Array:
        """Return the position nearest to a target where an agent may be, (2,), m.

        Args:
            target: (2,) m.
            position: (3,) of the agent, m; it stays in that region.
            taken: (2,) positions taken by other agents, m.
            spacing: Least distance from those, m.
        """
        region = self.region_of(position)
        if region < 0:
            return position[:2].copy()
        others = [Point(other).buffer(spacing) for other in taken]
        free = self.regions[region].difference(shapely.union_all(others))
        if free.is_empty:
            free = self.regions[region]
        nearest, _ = nearest_points(free, Point(target))
        return np.array([nearest.x, nearest.y])

    def goals(self, waypoints: Mapping[int, Waypoint]) -> Goals:
        """Return goals for the whole swarm, active for the agents that have a waypoint."""
        n = len(self.scene.agents)
        position, yaw = np.zeros((n, 3)), np.zeros(n)
        active: Mask = np.zeros(n, np.bool_)
        for row, waypoint in waypoints.items():
            position[row] = waypoint.x, waypoint.y, self.height
            yaw[row] = waypoint.yaw
            active[row] = True
        return Goals(position, np.zeros((n, 3)), yaw, np.full(n, self.speed), active)


def _free_regions(scene: Scene, height: float, clearance: float) -> list[Polygon]:
    """Where agents may be at a height."""
    low, high = scene.world.fence.low, scene.world.fence.high
    inside = shapely.box(*low[:2], *high[:2]).buffer(-clearance, join_style="mitre")
    filled = footprint(
        scene.world.obstacles, height - clearance, height + max(clearance, 1e-6), clearance
    )
    parts = shapely.get_parts(inside.difference(filled))
    return [part for part in parts if isinstance(part, Polygon) and not part.is_empty]
