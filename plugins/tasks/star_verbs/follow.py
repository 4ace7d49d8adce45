"""The verb ``follow``: fly along a path."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Estimate, Health, Scene, Status, Step
from star_verbs.assignment import assign
from star_verbs.crew import Crew
from star_verbs.path import Path
from star_verbs.routes import Route
from star_verbs.timeouts import time_out

NEAR = 0.15  # m: at the start and at the end
LAG = 0.3  # m behind its point that an agent may be before the points slow down
STOP = 0.6  # m behind its point at which they wait
CATCH_UP = 1.5  # times the path's speed is what an agent may fly to make up its lag
TURN = math.radians(60)  # rad/s: the yaw goal turns no faster
LEVEL = 1e-6  # a path's direction less level than this has no heading


class Follow:
    """Leads agents along a route by points that move on it at one pace.

    The agents first fly to where they begin. When all have stopped there the points set out; they
    slow down, all alike, when the agent farthest behind its point is more than `LAG` behind, and
    wait when it is `STOP` behind or not located. So agents keep their distance along the path, and
    an agent that makes way for another is waited for.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        route: The line, and where on it and beside it each of as many agents flies.
        speed: Speed along it, m/s; the scene's limit at most.
        along: Whether to look along the path; else the agents look where the route says, or
            where they looked when the step began.
        fault: Why the route cannot be flown; empty if it can.
    """

    def __init__(
        self,
        scene: Scene,
        rows: tuple[int, ...],
        route: Route,
        *,
        speed: float,
        along: bool,
        fault: str,
    ) -> None:
        self._crew = Crew(scene, rows)
        self._path = Path(route.point, route.yaw_deg)
        self._length = route.length
        self._ahead = np.array(route.ahead)  # (K,)
        self._beside = np.array(route.beside)  # (K, 3)
        self._speed = min(speed, scene.limits.speed)
        self._fastest = min(CATCH_UP * self._speed, scene.limits.speed)
        self._along = along
        self._fault = fault
        self._flown = 0.0
        self._time = 0.0
        self._under_way = False
        self._point: Array | None = None  # (K, 3) where the moving points were last
        self._yaw: Array = np.zeros(len(rows))

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._line_up(estimate)
        way = self._crew.journey(estimate, self._point) + self._length
        return time_out(way / self._speed)

    def step(self, estimate: Estimate, health: Health) -> Step:
        if self._fault:
            return Step(status=Status.FAILURE, reason=self._fault)
        if self._point is None:
            self._line_up(estimate)
            if self._point is None:
                return Step()
        passed, self._time = estimate.time - self._time, estimate.time
        lag = self._crew.farthest(estimate, self._point)
        if not self._under_way:
            self._under_way = lag <= NEAR and self._crew.slow(estimate)
        pace = self._pace(lag) if self._under_way else 0.0
        self._flown = min(self._flown + pace * passed, self._length)
        over = self._flown >= self._length
        point, tangent = self._path.at(self._ahead + self._flown)
        self._point = point + self._beside
        self._turn(tangent, passed)
        velocity = None if over else pace * tangent
        speed = self._fastest if self._under_way else self._speed
        goals = self._crew.goals(self._point, self._yaw, speed, velocity)
        done = over and self._crew.farthest(estimate, self._point) <= NEAR
        return Step(goals, status=Status.SUCCESS if done else Status.RUNNING)

    def stay(self, rows: tuple[int, ...]) -> None:
        kept = self._crew.stay(rows)
        self._ahead, self._beside = self._ahead[kept], self._beside[kept]
        self._yaw = self._yaw[kept]
        if self._point is not None:
            self._point = self._point[kept]

    def _line_up(self, estimate: Estimate) -> None:
        """Give each agent the beginning that suits all best."""
        if not self._crew.located(estimate):
            return
        start = self._path.at(self._ahead)[0] + self._beside
        mine = assign(estimate.position[self._crew.rows], start)
        self._ahead, self._beside = self._ahead[mine], self._beside[mine]
        self._point = start[mine]
        self._yaw = estimate.yaw[self._crew.rows]
        self._time = estimate.time

    def _pace(self, lag: float) -> float:
        """Speed of the moving points when the agent farthest behind is `lag` behind, m/s."""
        return self._speed * min(max((STOP - lag) / (STOP - LAG), 0.0), 1.0)

    def _turn(self, tangent: Array, passed: float) -> None:
        """Turn the yaw goals towards where the agents should look."""
        wanted: Array | None
        if self._along:
            level = np.hypot(tangent[:, 0], tangent[:, 1]) > LEVEL
            wanted = np.where(level, np.arctan2(tangent[:, 1], tangent[:, 0]), self._yaw)
        else:
            wanted = self._path.yaw(self._ahead + self._flown)
        if wanted is not None:
            error = (wanted - self._yaw + math.pi) % math.tau - math.pi
            most = TURN * passed
            turned = self._yaw + np.minimum(np.maximum(error, -most), most)
            self._yaw = (turned + math.pi) % math.tau - math.pi
