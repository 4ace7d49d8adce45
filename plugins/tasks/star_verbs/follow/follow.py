"""The verb ``follow``: fly along a path."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from star_core import Array, Command, Estimate, Health, Order, Scene, Status, TaskOutput, Trajectory
from star_core.toolkit import shortlist, wrap_angle
from star_verbs.follow.files import read_trajectory
from star_verbs.follow.routes import Polyline, route, route_faults
from star_verbs.follow.trajectory import PolynomialPath, Samples, is_relative, position_faults
from star_verbs.positions import Point, offsets
from star_verbs.step_agents import StepAgents, assign, lag_factor

TOLERANCE: Final = 0.15  # m: position error at the start and at the end
SLOW_LAG: Final = 0.3  # m: lag of an agent behind its reference from which on references slow down
STOP_LAG: Final = 0.6  # m: lag at which they stop
CATCH_UP: Final = 1.5  # times the path's speed: the speed limit of an agent that lags behind
MAX_YAW_RATE: Final = math.radians(60)  # rad/s, of the yaw goal
YAW_TOLERANCE: Final = math.radians(15)  # of the initial heading when a flight on board begins
MIN_HORIZONTAL: Final = 1e-6  # of a path's unit direction: less of it defines no heading


@dataclass(frozen=True, slots=True)
class Reference:
    """A line, and how a number of agents fly along it.

    Attributes:
        line: The line, parameterized by the distance flown, m, or by its own time, s.
        length: Range of the parameter that each agent flies.
        pace: Parameter flown in a second.
        approach_speed: Speed on the way to its beginning, m/s.
        max_speed: Speed limit of an agent that lags behind, m/s.
        start: Parameter at which each agent begins.
        offset: Offset of each agent's line, m; None lets it begin at the agent's position.
        fault: Returns why a line with these offsets cannot be flown; empty if it can.
        on_board: The line as flown on board; None steers the agents along it.
    """

    line: Polyline | PolynomialPath
    length: float
    pace: float
    approach_speed: float
    max_speed: float
    start: Sequence[float]
    offset: Sequence[Point] | None
    fault: Callable[[Sequence[Point]], str]
    on_board: Trajectory | None = None


def route_reference(scene: Scene, agents: int, options: dict[str, Any]) -> Reference:
    """Return the reference of `agents` agents along a file's waypoints or a named path.

    Raises:
        InputError: The file cannot be used.
    """
    flown = route(scene, agents, options)
    speed = min(options["speed"], scene.limits.speed)
    return Reference(
        line=Polyline(flown.point, flown.yaw_deg),
        length=flown.length,
        pace=speed,
        approach_speed=speed,
        max_speed=min(CATCH_UP * speed, scene.limits.speed),
        start=flown.start,
        offset=flown.offset,
        # Checked again: fewer agents than at the mission's check fly other lines.
        fault=lambda _offsets: shortlist(route_faults(scene, flown), "; "),
    )


def trajectory_reference(scene: Scene, agents: int, options: dict[str, Any]) -> Reference:
    """Return the reference of `agents` agents along a trajectory in its own time.

    Raises:
        InputError: The file cannot be used.
    """
    file = options["file"]
    path = read_trajectory(scene.file(file), file, options["format"])
    samples = Samples.of(path)
    return Reference(
        line=path,
        length=path.length,
        pace=1 / options["timescale"],
        approach_speed=scene.limits.speed,
        max_speed=scene.limits.speed,
        start=(0.0,) * agents,
        offset=None if is_relative(options) else offsets(agents, options["spacing"]),
        fault=lambda shifts: shortlist(position_faults(scene, samples, shifts, file), "; "),
        on_board=path.trajectory if options["on_board"] else None,
    )


class Follow:
    """Steers agents along a line by references that move on it at a common pace.

    The agents first fly to the starts of their lines. When all have stopped there the references
    start; they slow down together when the agent farthest behind its reference lags by more than
    `SLOW_LAG`, and stop when it lags by `STOP_LAG` or is not located. So agents keep their
    distances along the path, and the others wait for an agent that gives way to another.

    Agents that fly on board are commanded to when the references start. Then the references do not
    wait: they show where the agents should be, and steer those that do not fly on board.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        reference: The line, with the start and offset of each of as many agents.
        along: Whether to look along the path; otherwise the agents look in the line's direction, or
            keep their headings at the beginning of the step.

    Attributes:
        trajectories: Trajectories that they fly on board.
    """

    def __init__(
        self, scene: Scene, rows: tuple[int, ...], reference: Reference, *, along: bool
    ) -> None:
        self._agents = StepAgents(scene, rows)
        self._reference = reference
        self._start = np.array(reference.start, np.float64)  # (K,)
        self._offset = np.array(reference.offset or np.zeros((len(rows), 3)))  # (K, 3)
        self._along = along
        self.trajectories = () if reference.on_board is None else (reference.on_board,)
        self._fault = "" if reference.offset is None else reference.fault(reference.offset)
        self._flown = 0.0
        self._time = 0.0
        self._started = False
        self._point: Array | None = None  # (K, 3) last positions of the references
        self._yaw: Array = np.zeros(len(rows))

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._line_up(estimate)
        reference = self._reference
        travel = self._agents.travel_distance(estimate, self._point)
        takes = travel / reference.approach_speed + reference.length / reference.pace
        return self._agents.timeout(takes)

    def step(self, estimate: Estimate, health: Health) -> TaskOutput:
        if self._point is None:
            self._line_up(estimate)
        if self._fault:
            return TaskOutput(status=Status.FAILURE, reason=self._fault)
        if self._point is None:
            return TaskOutput()
        reference = self._reference
        elapsed, self._time = estimate.time - self._time, estimate.time
        lag = self._agents.max_distance(estimate, self._point)
        commands: tuple[Command, ...] = ()
        if not self._started and self._lined_up(estimate, lag):
            self._started = True
            if reference.on_board is not None:
                commands, elapsed = (self._on_board_command(reference.on_board),), 0.0
        pace = self._pace(lag) if self._started else 0.0
        self._flown = min(self._flown + pace * elapsed, reference.length)
        over = self._flown >= reference.length
        point, tangent = reference.line.at(self._start + self._flown)
        self._point = point + self._offset
        self._turn(tangent, elapsed)
        speed = reference.max_speed if self._started else reference.approach_speed
        motion = () if over else self._motion(pace, tangent)
        goals = self._agents.goals(self._point, self._yaw, speed, *motion)
        done = over and self._agents.max_distance(estimate, self._point) <= TOLERANCE
        return TaskOutput(goals, commands, Status.SUCCESS if done else Status.RUNNING)

    def on_agents_removed(self, rows: tuple[int, ...]) -> None:
        kept = self._agents.keep(rows)
        self._start, self._offset = self._start[kept], self._offset[kept]
        self._yaw = self._yaw[kept]
        if self._point is not None:
            self._point = self._point[kept]

    def on_agent_replaced(self, old: int, new: int) -> None:
        self._agents.replace(old, new)

    def _line_up(self, estimate: Estimate) -> None:
        """Assign each agent a start so that the total distance is minimal."""
        if not self._agents.located(estimate):
            return
        reference = self._reference
        start, position = reference.line.at(self._start)[0], estimate.position[self._agents.rows]
        if reference.offset is None:
            self._offset = position - start
            self._fault = reference.fault([(x, y, z) for x, y, z in self._offset.tolist()])
        else:
            assigned = assign(position, start + self._offset)
            start, self._start, self._offset = (
                start[assigned],
                self._start[assigned],
                self._offset[assigned],
            )
        self._point = start + self._offset
        self._yaw = estimate.yaw[self._agents.rows]
        self._time = estimate.time

    def _lined_up(self, estimate: Estimate, lag: float) -> bool:
        """Whether all have stopped at their starts; on board, also with the initial heading."""
        if lag > TOLERANCE or not self._agents.at_rest(estimate):
            return False
        reference = self._reference
        yaw = None if reference.on_board is None else reference.line.yaw(self._start)
        if yaw is None:
            return True
        error = wrap_angle(estimate.yaw[self._agents.rows] - yaw)
        return bool(np.abs(error).max() <= YAW_TOLERANCE)

    def _on_board_command(self, trajectory: Trajectory) -> Command:
        """Return the command to fly a trajectory from the agents' starts."""
        rows = self._agents.rows
        seconds = np.full(len(rows), self._reference.length / self._reference.pace)
        return Command(Order.FOLLOW, rows, self._offset, np.zeros(len(rows)), seconds, trajectory)

    def _pace(self, lag: float) -> float:
        """Pace of the references when the farthest agent lags by `lag` m."""
        pace = self._reference.pace
        on_board = self._reference.on_board is not None
        return pace if on_board else pace * lag_factor(lag, SLOW_LAG, STOP_LAG)

    def _motion(self, pace: float, tangent: Array) -> tuple[Array, ...]:
        """Return velocities of the references; with them, along a trajectory, their changes.

        Args:
            pace: Of the references.
            tangent: (K, 3) derivatives of their positions.
        """
        line = self._reference.line
        if not isinstance(line, PolynomialPath) or not self._started:
            return (pace * tangent,)
        acceleration, yaw_rate = line.acceleration(self._start + self._flown)
        if self._along or not line.turns:
            yaw_rate = np.full(len(yaw_rate), np.nan)
        return pace * tangent, pace**2 * acceleration, pace * yaw_rate

    def _turn(self, tangent: Array, elapsed: float) -> None:
        """Turn the yaw goals towards the headings that the agents should have."""
        yaw: Array | None
        if self._along:
            horizontal = np.hypot(tangent[:, 0], tangent[:, 1]) > MIN_HORIZONTAL
            yaw = np.where(horizontal, np.arctan2(tangent[:, 1], tangent[:, 0]), self._yaw)
        else:
            yaw = self._reference.line.yaw(self._start + self._flown)
        if yaw is not None:
            limit = MAX_YAW_RATE * elapsed
            self._yaw = wrap_angle(self._yaw + np.clip(wrap_angle(yaw - self._yaw), -limit, limit))
