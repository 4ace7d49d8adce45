"""The tables that pass through one tick: frozen, with one row per agent.

Row *i* is the same agent in every table of a mission. Frames are right-handed with z up, units SI,
floats float64. Arrays are read-only: a stage that wants a changed table makes a new one with
`dataclasses.replace`. Ragged data is a long table with an agent column.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from enum import IntEnum
from functools import cache, partial
from typing import Final, Self

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows, Table, column, counted, frozen, some, table
from star_core.messages.rotations import Transform
from star_core.messages.telemetry import Corrections, Detections, Sightings


class AgentPhase(IntEnum):
    """Phase of an agent's flight."""

    GROUNDED = 0
    TAKING_OFF = 1
    FLYING = 2
    LANDING = 3
    LANDED = 4
    LOST = 5  # not heard from, or not located
    EMERGENCY = 6  # tumbled, locked, crashed, or its motors were stopped

    __hash__ = int.__hash__  # that of `Enum` hashes the name, in Python


AIRBORNE: Final = (
    AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LANDING, AgentPhase.LOST,
)  # fmt: skip
"""Phases of agents that are, or may be, in the air."""

UNFIT: Final = (AgentPhase.LOST, AgentPhase.EMERGENCY)
"""Phases in which an agent cannot continue a step."""


@cache
def _zeros(n: int) -> Array:
    """(N, 3) zeros that are read-only."""
    return frozen(np.zeros((n, 3)))


@table()
class Estimate(Table):
    """A localizer's estimate of the agents' states, in the map.

    Attributes:
        time: Mission time, s.
        position: m.
        velocity: m/s.
        yaw: rad, anticlockwise from the map's x axis.
        covariance: Covariance of the position, m².
        valid: False if the row must not be used to fly.
        map_from_odom: Pose of each agent's odometry frame in the map.
        sightings: Tags seen since the last tick that are not landmarks.
        corrections: For the on-board estimators.
        possible_travel: m. An agent that is no longer heard, or no longer located in flight,
            may have stopped at `position` or flown on, up to `position + possible_travel`. Set by
            the core, not by localizers; zero for other agents, which is the default.
        detections: All tags that the localizer detected in images since the last tick, also those
            that it did not use; for records and displays only. Results of an image may be late.
        messages: Lines for the record, such as what the localizer no longer receives; each once.
        heights: z (m) and climb (m/s) in the odometry frame that each agent would report if what is
            below it had not changed since its start; None if they are as reported.
    """

    time: float
    position: Array = column(3)
    velocity: Array = column(3)
    yaw: Array = column()
    covariance: Array = column(3, 3)
    valid: Mask = column()
    map_from_odom: Transform = counted()
    sightings: Sightings = field(default_factory=Sightings.none)
    corrections: Corrections = field(default_factory=Corrections.none)
    possible_travel: Array = column(3, default_factory=partial(_zeros, 0))
    detections: Detections = field(default_factory=Detections.none)
    messages: tuple[str, ...] = ()
    heights: Array | None = column(2, default=None)

    def __post_init__(self) -> None:
        if not len(self.possible_travel):
            object.__setattr__(self, "possible_travel", _zeros(len(self.map_from_odom.yaw)))
        Table.__post_init__(self)


@table()
class Health(Table):
    """The condition of the agents, for tasks, beside the estimate.

    Attributes:
        phase: `AgentPhase`.
        battery: V; NaN where not reported.
        age: Time since each agent was last heard, s.
        finder: Row of the agent that found each target of the world, in the world's order; -1
            if it has not been found.
    """

    phase: Rows = column()
    battery: Array = column()
    age: Array = column()
    finder: Rows = column(per="target", default_factory=lambda: np.zeros(0, np.int64))


def among(phase: Rows, *phases: AgentPhase) -> Mask:
    """Return which agents, with phases (N,), are in one of some phases: (N,)."""
    among: Mask = _members(phases).take(phase)
    return among


@cache
def _members(phases: tuple[AgentPhase, ...]) -> Mask:
    """Whether each phase is one of some."""
    return np.array([phase in phases for phase in AgentPhase])


@table()
class Goals(Table):
    """The tasks' goals for the agents, in the map.

    Attributes:
        position: m.
        velocity: Velocity of a moving goal, m/s: feed-forward.
        yaw: rad.
        speed: Greatest speed on the way, m/s.
        active: False for agents without a goal.
        acceleration: Of a goal that moves along a known trajectory, m/s²; NaN in rows where it is
            not known, None if it is in none.
        yaw_rate: Likewise, rad/s.
    """

    position: Array = column(3)
    velocity: Array = column(3)
    yaw: Array = column()
    speed: Array = column()
    active: Mask = column()
    acceleration: Array | None = column(3, default=None)
    yaw_rate: Array | None = column(default=None)


@table()
class Setpoint(Table):
    """The setpoints of the agents until the next tick, in the map.

    Attributes:
        velocity: m/s.
        yaw: rad, anticlockwise from the map's x axis.
        active: False for agents without a setpoint (grounded, taking off, landing, not heard);
            an avoider leaves them inactive.
        position: Of the trajectory that `velocity` leads along, m, in rows of agents that follow
            one; NaN in other rows, None if there is none. Where avoider or safety filter change
            the velocity, the core removes it: the row is then flown by its velocity.
        acceleration: Of that trajectory, m/s², likewise.
        yaw_rate: Of `yaw`, rad/s, likewise.
    """

    velocity: Array = column(3)
    yaw: Array = column()
    active: Mask = column()
    position: Array | None = column(3, default=None)
    acceleration: Array | None = column(3, default=None)
    yaw_rate: Array | None = column(default=None)

    def followed(self) -> Mask:
        """Return the active rows with a trajectory to follow: (N,)."""
        if self.position is None or self.acceleration is None:
            return np.zeros(len(self.active), np.bool_)
        finite = np.isfinite(self.position).all(axis=1) & np.isfinite(self.acceleration).all(axis=1)
        followed: Mask = self.active & finite
        return followed

    def following(self, other: Setpoint, rows: Mask) -> Setpoint:
        """Return this setpoint with the trajectory of another in some rows, (N,), and no others."""
        if other.position is None or other.acceleration is None or not some(rows):
            if self.position is None and self.acceleration is None:
                return self
            return Setpoint.made(self.velocity, self.yaw, self.active)
        column, rate = rows[:, None], other.yaw_rate
        return Setpoint.made(
            self.velocity,
            self.yaw,
            self.active,
            np.where(column, other.position, np.nan),
            np.where(column, other.acceleration, np.nan),
            np.where(rows, 0.0 if rate is None else np.nan_to_num(rate), np.nan),
        )


def with_possible_positions(
    estimate: Estimate, planned: Setpoint, spacing: float = 0.2
) -> tuple[Estimate, Setpoint]:
    """Return both tables with further rows at the possible positions of agents that are not heard.

    These rows follow those of the agents: at rest, inactive, along the segment from
    each agent's position to the end of its `Estimate.possible_travel`. An avoider that handles them
    like any inactive agent keeps the others clear of all possible positions of an agent that is no
    longer heard. If every agent is heard, the tables are returned unchanged.

    Args:
        estimate: Of N agents.
        planned: Of N agents.
        spacing: Greatest distance between two rows of one agent, m.

    Example:
        >>> from star_core.testing import estimate
        >>> now = replace(estimate(np.zeros((1, 3))), possible_travel=np.array([[0.3, 0, 0]]))
        >>> still = Setpoint(np.zeros((1, 3)), np.zeros(1), np.zeros(1, np.bool_))
        >>> with_possible_positions(now, still)[0].position[:, 0]
        array([0.  , 0.15, 0.3 ])
    """
    if not np.count_nonzero(estimate.possible_travel):
        return estimate, planned
    length = np.linalg.norm(estimate.possible_travel, axis=1)
    steps = np.ceil(np.where(np.isfinite(length), length, 0.0) / spacing).astype(int)
    k = int(steps.sum())
    if k == 0:
        return estimate, planned
    n = len(steps)
    row = np.concatenate([np.arange(n), np.repeat(np.arange(n), steps)])
    share = np.concatenate([np.zeros(n), *(np.arange(1, s + 1) / s for s in steps if s)])
    added = np.arange(n + k) >= n
    return replace(
        estimate,
        position=estimate.position[row] + share[:, None] * estimate.possible_travel[row],
        velocity=np.where(added[:, None], 0.0, estimate.velocity[row]),
        yaw=estimate.yaw[row],
        covariance=estimate.covariance[row],
        valid=estimate.valid[row] & ~added,
        heights=None,
        map_from_odom=estimate.map_from_odom.of(row),
        possible_travel=np.zeros((n + k, 3)),
    ), Setpoint(
        velocity=np.where(added[:, None], 0.0, planned.velocity[row]),
        yaw=planned.yaw[row],
        active=planned.active[row] & ~added,
    )


@table(per="point")
class Paths(Table):
    """Planned polylines of agents, in the map: a long table.

    Attributes:
        agent: Row of the agent; the points of one agent are consecutive, in order.
        point: m.
    """

    agent: Rows = column()
    point: Array = column(3)

    def of(self, row: int) -> Array:
        """Return the points of an agent's path, (K, 3) m."""
        points: Array = self.point[self.agent == row]
        return points

    def beyond(self, position: Array) -> Self:
        """Return the paths without their first points where these are the agents' positions.

        What is left changes only when an agent replans, passes a corner, or its goal moves.

        Args:
            position: (N, 3) m.
        """
        first = np.diff(self.agent, prepend=-1) != 0
        kept = ~first | (self.point != position[self.agent]).any(axis=1)
        return type(self)(self.agent[kept], self.point[kept])

    def changed(self, before: Self) -> Rows:
        """Return the rows of the agents whose paths differ from those of another table."""
        current, previous = (self.agent, self.point), (before.agent, before.point)
        if all(map(np.array_equal, current, previous)):
            return np.zeros(0, np.int64)
        rows = np.union1d(self.agent, before.agent)
        same = [np.array_equal(self.of(row), before.of(row)) for row in rows.tolist()]
        return rows[~np.array(same, np.bool_)]


@table()
class Plan(Table):
    """A planner's output.

    Attributes:
        setpoint: Of this tick.
        paths: The rest of each agent's path.
        unreachable: True for agents whose goals cannot be reached: their steps fail.
        reasons: Why, by row, in words, if the planner can explain it.
    """

    setpoint: Setpoint = counted()
    paths: Paths
    unreachable: Mask = column()
    reasons: Mapping[int, str] = field(default_factory=dict)

    @classmethod
    def none(cls, n: int = 0) -> Self:
        """Return a plan without a setpoint for `n` agents."""
        return cls(Setpoint.none(n), Paths.none(), np.zeros(n, np.bool_))


@table()
class Truth(Table):
    """Ground truth in the map, of a simulator or motion capture; for records only.

    Attributes:
        time: Mission time, s.
        position: m.
        velocity: m/s.
        attitude: Unit quaternion x, y, z, w from the body to the map.
    """

    time: float
    position: Array = column(3)
    velocity: Array = column(3)
    attitude: Array = column(4)
