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
    TaskOutput,
    Trajectory,
    timeout,
    wrap_angle,
)
from star_verbs.assignment import assign
from star_verbs.step_agents import StepAgents

Point = tuple[float, float, float]

NEAR = 0.15  # m: position tolerance at the start and at the end
LAG = 0.3  # m: lag of an agent behind its moving point from which on the points slow down
STOP = 0.6  # m: lag at which the points stop
TURN = math.radians(60)  # rad/s: rate limit of the yaw goal
FACING = math.radians(15)  # of the initial heading: tolerance when a flight on board begins
LEVEL = 1e-6  # least horizontal component of a path's direction that defines a heading


class Line(Protocol):
    """A line, parameterized by how much of it is flown: a distance, m, or a time, s."""

    def at(self, flown: Array) -> tuple[Array, Array]:
        """Return (K, 3) points, m, and (K, 3) their derivatives, at (K,) parameters."""
        ...

    def yaw(self, flown: Array) -> Array | None:
        """Return (K,) headings at (K,) parameters, rad; None if the line has none."""
        ...


@dataclass(frozen=True, slots=True)
class Way:
    """A line, and how a number of agents fly along it.

    Attributes:
        line: The line.
        length: Part of it each agent flies: m, or s of its own time.
        pace: Part of it flown in a second.
        speed: Speed on the way to its beginning, m/s.
        fastest: Speed limit of an agent that lags behind, m/s.
        ahead: Parameter at which each agent begins.
        beside: Offset of each agent's line, m; None lets it begin at the agent's position.
        fault: Returns why a line with these offsets cannot be flown; empty if it can.
        on_board: The line as flown on board; None steers the agents along it.
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
    """Steers agents along a line by points that move on it at a common pace.

    The agents first fly to the starts of their lines. When all have stopped there the points start;
    they slow down together when the agent farthest behind its point lags by more than `LAG`, and
    stop when it lags by `STOP` or is not located. So agents keep their distances along the path,
    and the others wait for an agent that gives way to another.

    Agents that fly on board are commanded to when the points start. Then the points do not wait:
    they show where the agents should be, and steer those that do not fly on board.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        way: The line, with the start and offset of each of as many agents.
        along: Whether to look along the path; otherwise the agents look in the line's direction, or
            keep their headings at the beginning of the step.

    Attributes:
        trajectories: Trajectories that they fly on board.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], way: Way, *, along: bool) -> None:
        self._agents = StepAgents(scene, rows)
        self._way = way
        self._ahead = np.array(way.ahead, np.float64)  # (K,)
        self._beside = np.array(way.beside or np.zeros((len(rows), 3)))  # (K, 3)
        self._along = along
        self.trajectories = () if way.on_board is None else (way.on_board,)
        self._fault = "" if way.beside is None else way.fault(way.beside)
        self._flown = 0.0
        self._time = 0.0
        self._under_way = False
        self._point: Array | None = None  # (K, 3) last positions of the moving points
        self._yaw: Array = np.zeros(len(rows))

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._line_up(estimate)
        way = self._way
        journey = self._agents.journey(estimate, self._point)
        return timeout(journey / way.speed + way.length / way.pace)

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if self._point is None:
            self._line_up(estimate)
        if self._fault:
            return TaskOutput(status=Status.FAILURE, reason=self._fault)
        if self._point is None:
            return TaskOutput()
        passed, self._time = estimate.time - self._time, estimate.time
        lag = self._agents.farthest(estimate, self._point)
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
        goals = self._agents.goals(self._point, self._yaw, speed, velocity)
        done = over and self._agents.farthest(estimate, self._point) <= NEAR
        return TaskOutput(goals, commands, Status.SUCCESS if done else Status.RUNNING)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        kept = self._agents.keep(rows)
        self._ahead, self._beside = self._ahead[kept], self._beside[kept]
        self._yaw = self._yaw[kept]
        if self._point is not None:
            self._point = self._point[kept]

    def on_agent_replaced(self, old: int, new: int) -> None:
        self._agents.replace(old, new)

    def _line_up(self, estimate: Estimate) -> None:
        """Assign each agent a start so that the total distance is minimal."""
        if not self._agents.located(estimate):
            return
        start, here = self._way.line.at(self._ahead)[0], estimate.position[self._agents.rows]
        if self._way.beside is None:
            self._beside = here - start
            self._fault = self._way.fault([(x, y, z) for x, y, z in self._beside.tolist()])
        else:
            mine = assign(here, start + self._beside)
            start, self._ahead, self._beside = start[mine], self._ahead[mine], self._beside[mine]
        self._point = start + self._beside
        self._yaw = estimate.yaw[self._agents.rows]
        self._time = estimate.time

    def _lined_up(self, estimate: Estimate, lag: float) -> bool:
        """Whether all have stopped at their starts; on board, also with the initial heading."""
        if lag > NEAR or not self._agents.slow(estimate):
            return False
        yaw = None if self._way.on_board is None else self._way.line.yaw(self._ahead)
        if yaw is None:
            return True
        off = wrap_angle(estimate.yaw[self._agents.rows] - yaw)
        return bool(np.abs(off).max() <= FACING)

    def _order(self, trajectory: Trajectory) -> Command:
        """Return the command to fly a trajectory from the agents' starts."""
        rows = self._agents.rows
        seconds = np.full(len(rows), self._way.length / self._way.pace)
        unturned = np.zeros(len(rows))
        return Command(Order.FOLLOW, rows, self._beside, unturned, seconds, trajectory)

    def _pace(self, lag: float) -> float:
        """Pace of the points when the farthest agent lags by `lag` m."""
        if self._way.on_board is not None:
            return self._way.pace
        return self._way.pace * min(max((STOP - lag) / (STOP - LAG), 0.0), 1.0)

    def _turn(self, tangent: Array, passed: float) -> None:
        """Turn the yaw goals towards the headings that the agents should have."""
        wanted: Array | None
        if self._along:
            level = np.hypot(tangent[:, 0], tangent[:, 1]) > LEVEL
            wanted = np.where(level, np.arctan2(tangent[:, 1], tangent[:, 0]), self._yaw)
        else:
            wanted = self._way.line.yaw(self._ahead + self._flown)
        if wanted is not None:
            error = wrap_angle(wanted - self._yaw)
            most = TURN * passed
            self._yaw = wrap_angle(self._yaw + np.minimum(np.maximum(error, -most), most))
