"""The verb ``follow``: fly along a path."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from star_core import (
    Array,
    Command,
    Estimate,
    Health,
    Order,
    Scene,
    Status,
    Step,
    Trajectory,
)
from star_verbs.assignment import assign
from star_verbs.crew import Crew
from star_verbs.timeouts import time_out

Point = tuple[float, float, float]

NEAR = 0.15  # m: at the start and at the end
LAG = 0.3  # m behind its point that an agent may be before the points slow down
STOP = 0.6  # m behind its point at which they wait
TURN = math.radians(60)  # rad/s: the yaw goal turns no faster
FACING = math.radians(15)  # of where it begins to look, as an agent sets out on board
LEVEL = 1e-6  # a path's direction less level than this has no heading


class Line(Protocol):
    """Where a line is, by how much of it is flown: a distance, m, or a time, s."""

    def at(self, flown: Array) -> tuple[Array, Array]:
        """Return (K, 3) points, m, and (K, 3) their derivatives, at (K,) places."""
        ...

    def yaw(self, flown: Array) -> Array | None:
        """Return (K,) headings at (K,) places, rad; None if the line has none."""
        ...


@dataclass(frozen=True, slots=True)
class Way:
    """A line, and how a number of agents fly along it.

    Attributes:
        line: The line.
        length: How much of it each agent flies: m, or s of its own time.
        pace: How much of it is flown in a second.
        speed: Speed on the way to its beginning, m/s.
        fastest: What an agent may fly to make up its lag, m/s.
        ahead: Where on it each agent begins.
        beside: How far each agent's line is shifted, m; None lets it begin where the agent is.
        fault: Says why a line that is shifted so cannot be flown; nothing if it can.
        on_board: The line as the agents fly it on their own; None leads them along it.
    """

    line: Line
    length: float
    pace: float
    speed: float
    fastest: float
    ahead: Sequence[float]
    beside: Sequence[Point] | None
    fault: Callable[[Sequence[Point]], str]
    on_board: Trajectory | None = None


class Follow:
    """Leads agents along a line by points that move on it at one pace.

    The agents first fly to where they begin. When all have stopped there the points set out; they
    slow down, all alike, when the agent farthest behind its point is more than `LAG` behind, and
    wait when it is `STOP` behind or not located. So agents keep their distance along the path, and
    an agent that makes way for another is waited for.

    Agents that fly on board are ordered to as the points set out. Then nobody is waited for: the
    points show where they should be, and lead whoever does not fly on its own.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        way: The line, and where on it and beside it each of as many agents flies.
        along: Whether to look along the path; else the agents look where the line says, or
            where they looked when the step began.

    Attributes:
        trajectories: What they fly on board.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], way: Way, *, along: bool) -> None:
        self._crew = Crew(scene, rows)
        self._way = way
        self._ahead = np.array(way.ahead, np.float64)  # (K,)
        self._beside = np.array(way.beside or np.zeros((len(rows), 3)))  # (K, 3)
        self._along = along
        self.trajectories = () if way.on_board is None else (way.on_board,)
        self._fault = "" if way.beside is None else way.fault(way.beside)
        self._flown = 0.0
        self._time = 0.0
        self._under_way = False
        self._point: Array | None = None  # (K, 3) where the moving points were last
        self._yaw: Array = np.zeros(len(rows))

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._line_up(estimate)
        way = self._way
        journey = self._crew.journey(estimate, self._point)
        return time_out(journey / way.speed + way.length / way.pace)

    def step(self, estimate: Estimate, health: Health) -> Step:
        if self._point is None:
            self._line_up(estimate)
        if self._fault:
            return Step(status=Status.FAILURE, reason=self._fault)
        if self._point is None:
            return Step()
        passed, self._time = estimate.time - self._time, estimate.time
        lag = self._crew.farthest(estimate, self._point)
        commands: tuple[Command, ...] = ()
        if not self._under_way and self._lined_up(estimate, lag):
            self._under_way = True
            if self._way.on_board is not None:
                commands, passed = (self._order(self._way.on_board),), 0.0
        pace = self._pace(lag) if self._under_way else 0.0
        self._flown = min(self._flown + pace * passed, self._way.length)
        over = self._flown >= self._way.length
        point, tangent = self._way.line.at(self._ahead + self._flown)
        self._point = point + self._beside
        self._turn(tangent, passed)
        velocity = None if over else pace * tangent
        speed = self._way.fastest if self._under_way else self._way.speed
        goals = self._crew.goals(self._point, self._yaw, speed, velocity)
        done = over and self._crew.farthest(estimate, self._point) <= NEAR
        return Step(goals, commands, Status.SUCCESS if done else Status.RUNNING)

    def stay(self, rows: tuple[int, ...]) -> None:
        kept = self._crew.stay(rows)
        self._ahead, self._beside = self._ahead[kept], self._beside[kept]
        self._yaw = self._yaw[kept]
        if self._point is not None:
            self._point = self._point[kept]

    def swap(self, old: int, new: int) -> None:
        self._crew.swap(old, new)

    def _line_up(self, estimate: Estimate) -> None:
        """Give each agent the beginning that suits all best."""
        if not self._crew.located(estimate):
            return
        start, here = self._way.line.at(self._ahead)[0], estimate.position[self._crew.rows]
        if self._way.beside is None:
            self._beside = here - start
            self._fault = self._way.fault([(x, y, z) for x, y, z in self._beside.tolist()])
        else:
            mine = assign(here, start + self._beside)
            start, self._ahead, self._beside = start[mine], self._ahead[mine], self._beside[mine]
        self._point = start + self._beside
        self._yaw = estimate.yaw[self._crew.rows]
        self._time = estimate.time

    def _lined_up(self, estimate: Estimate, lag: float) -> bool:
        """Whether all have stopped at their beginnings; on board they also look where it begins."""
        if lag > NEAR or not self._crew.slow(estimate):
            return False
        yaw = None if self._way.on_board is None else self._way.line.yaw(self._ahead)
        if yaw is None:
            return True
        off = np.remainder(estimate.yaw[self._crew.rows] - yaw + math.pi, math.tau) - math.pi
        return bool(np.abs(off).max() <= FACING)

    def _order(self, trajectory: Trajectory) -> Command:
        """Have all fly a trajectory from where they are lined up."""
        rows = self._crew.rows
        seconds = np.full(len(rows), self._way.length / self._way.pace)
        unturned = np.zeros(len(rows))
        return Command(Order.FOLLOW, rows, self._beside, unturned, seconds, trajectory)

    def _pace(self, lag: float) -> float:
        """How much of the line is flown in a second when the farthest agent is `lag` m behind."""
        if self._way.on_board is not None:
            return self._way.pace
        return self._way.pace * min(max((STOP - lag) / (STOP - LAG), 0.0), 1.0)

    def _turn(self, tangent: Array, passed: float) -> None:
        """Turn the yaw goals towards where the agents should look."""
        wanted: Array | None
        if self._along:
            level = np.hypot(tangent[:, 0], tangent[:, 1]) > LEVEL
            wanted = np.where(level, np.arctan2(tangent[:, 1], tangent[:, 0]), self._yaw)
        else:
            wanted = self._way.line.yaw(self._ahead + self._flown)
        if wanted is not None:
            error = (wanted - self._yaw + math.pi) % math.tau - math.pi
            most = TURN * passed
            turned = self._yaw + np.minimum(np.maximum(error, -most), most)
            self._yaw = (turned + math.pi) % math.tau - math.pi
