"""The tables that pass through one tick: frozen, with one row per agent.

Row *i* is the same agent in every table of a mission. Frames are right-handed with z up, units SI,
floats float64. Arrays are read-only: a stage that wants a changed table makes a new one with
`dataclasses.replace`. Ragged data is a long table with an agent column.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cache, partial
from typing import Final, Self

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows, freeze_arrays
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


AIRBORNE: Final = (
    AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LANDING, AgentPhase.LOST,
)  # fmt: skip
"""Phases of agents that are, or may be, in the air."""

UNFIT: Final = (AgentPhase.LOST, AgentPhase.EMERGENCY)
"""Phases in which an agent cannot continue a step."""


@cache
def _zeros(n: int) -> Array:
    """(N, 3) zeros that are read-only."""
    zeros = np.zeros((n, 3))
    zeros.flags.writeable = False
    return zeros


@dataclass(frozen=True, slots=True)
class Estimate:
    """A localizer's estimate of the agents' states, in the map.

    Attributes:
        time: Mission time, s.
        position: (N, 3) m.
        velocity: (N, 3) m/s.
        yaw: (N,) rad, anticlockwise from the map's x axis.
        covariance: (N, 3, 3) covariance of the position, m².
        valid: (N,) False if the row must not be used to fly.
        map_from_odom: Pose of each agent's odometry frame in the map.
        sightings: Tags seen since the last tick that are not landmarks.
        corrections: For the on-board estimators.
        possible_travel: (N, 3) m. An agent that is no longer heard, or no longer located in flight,
            may have stopped at `position` or flown on, up to `position + possible_travel`. Set by
            the core, not by localizers; zero for other agents, which is the default.
        detections: All tags that the localizer detected in images since the last tick, also those
            that it did not use; for records and displays only. Results of an image may be late.
    """

    time: float
    position: Array
    velocity: Array
    yaw: Array
    covariance: Array
    valid: Mask
    map_from_odom: Transform
    sightings: Sightings = field(default_factory=Sightings.none)
    corrections: Corrections = field(default_factory=Corrections.none)
    possible_travel: Array = field(default_factory=partial(_zeros, 0))
    detections: Detections = field(default_factory=Detections.none)

    def __post_init__(self) -> None:
        frames = {"map_from_odom": len(self.map_from_odom.yaw)}
        if not len(self.possible_travel):
            object.__setattr__(self, "possible_travel", _zeros(frames["map_from_odom"]))
        numbers = {
            "position": (3,), "velocity": (3,), "yaw": (), "covariance": (3, 3),
            "possible_travel": (3,),
        }  # fmt: skip
        freeze_arrays(self, numbers, flags=("valid",), others=frames)


@dataclass(frozen=True, slots=True)
class Health:
    """The condition of the agents, for tasks, beside the estimate.

    Attributes:
        phase: (N,) `AgentPhase`.
        battery: (N,) V; NaN where not reported.
        age: (N,) time since each agent was last heard, s.
        finder: (T,) row of the agent that found each target of the world, in the world's order; -1
            if it has not been found.
    """

    phase: Rows
    battery: Array
    age: Array
    finder: Rows = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        freeze_arrays(self, {"battery": (), "age": ()}, integers=("phase",))
        freeze_arrays(self, {}, integers=("finder",), per="target")


def among(phase: Rows, *phases: AgentPhase) -> Mask:
    """Return which agents, with phases (N,), are in one of some phases: (N,)."""
    answer: Mask = phase == phases[0]
    for another in phases[1:]:
        answer |= phase == another
    return answer


@dataclass(frozen=True, slots=True)
class Goals:
    """The tasks' goals for the agents, in the map.

    Attributes:
        position: (N, 3) m.
        velocity: (N, 3) velocity of a moving goal, m/s: feed-forward.
        yaw: (N,) rad.
        speed: (N,) greatest speed on the way, m/s.
        active: (N,) False for agents without a goal.
    """

    position: Array
    velocity: Array
    yaw: Array
    speed: Array
    active: Mask

    def __post_init__(self) -> None:
        numbers = {"position": (3,), "velocity": (3,), "yaw": (), "speed": ()}
        freeze_arrays(self, numbers, flags=("active",))

    @classmethod
    def none(cls, n: int) -> Self:
        """Return a table without a goal for `n` agents."""
        zero = np.zeros(n)
        return cls(np.zeros((n, 3)), np.zeros((n, 3)), zero, zero, np.zeros(n, np.bool_))


@dataclass(frozen=True, slots=True)
class Setpoint:
    """The setpoints of the agents until the next tick, in the map.

    Attributes:
        velocity: (N, 3) m/s.
        yaw: (N,) rad, anticlockwise from the map's x axis.
        active: (N,) False for agents without a setpoint (grounded, taking off, landing, not heard);
            an avoider leaves them inactive.
    """

    velocity: Array
    yaw: Array
    active: Mask

    def __post_init__(self) -> None:
        freeze_arrays(self, {"velocity": (3,), "yaw": ()}, flags=("active",))


def with_possible_positions(
    estimate: Estimate, wanted: Setpoint, spacing: float = 0.2
) -> tuple[Estimate, Setpoint]:
    """Return both tables with further rows at the possible positions of agents that are not heard.

    These rows follow those of the agents: at rest, inactive, along the segment from
    each agent's position to the end of its `Estimate.possible_travel`. An avoider that handles them
    like any inactive agent keeps the others clear of all possible positions of an agent that is no
    longer heard. If every agent is heard, the tables are returned unchanged.

    Args:
        estimate: Of N agents.
        wanted: Of N agents.
        spacing: Greatest distance between two rows of one agent, m.

    Example:
        >>> from star_core.testing import estimate
        >>> now = replace(estimate(np.zeros((1, 3))), possible_travel=np.array([[0.3, 0, 0]]))
        >>> still = Setpoint(np.zeros((1, 3)), np.zeros(1), np.zeros(1, np.bool_))
        >>> with_possible_positions(now, still)[0].position[:, 0]
        array([0.  , 0.15, 0.3 ])
    """
    length = np.linalg.norm(estimate.possible_travel, axis=1)
    steps = np.ceil(np.where(np.isfinite(length), length, 0.0) / spacing).astype(int)
    k = int(steps.sum())
    if k == 0:
        return estimate, wanted
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
        map_from_odom=estimate.map_from_odom.of(row),
        possible_travel=np.zeros((n + k, 3)),
    ), Setpoint(
        velocity=np.where(added[:, None], 0.0, wanted.velocity[row]),
        yaw=wanted.yaw[row],
        active=wanted.active[row] & ~added,
    )


@dataclass(frozen=True, slots=True)
class Paths:
    """Planned polylines of agents, in the map: a long table.

    Attributes:
        agent: (K,) row of the agent; the points of one agent are consecutive, in order.
        point: (K, 3) m.
    """

    agent: Rows
    point: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, {"point": (3,)}, integers=("agent",), per="point")

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
        one, two = (self.agent, self.point), (before.agent, before.point)
        if all(map(np.array_equal, one, two)):
            return np.zeros(0, np.int64)
        rows = np.union1d(self.agent, before.agent)
        same = [np.array_equal(self.of(row), before.of(row)) for row in rows.tolist()]
        return rows[~np.array(same, np.bool_)]

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without a path."""
        return cls(np.zeros(0, np.int64), np.zeros((0, 3)))


@dataclass(frozen=True, slots=True)
class Plan:
    """A planner's output.

    Attributes:
        setpoint: Of this tick.
        paths: The rest of each agent's path.
        unreachable: (N,) True for agents whose goals cannot be reached: their steps fail.
        reasons: Why, by row, in words, if the planner can explain it.
    """

    setpoint: Setpoint
    paths: Paths
    unreachable: Mask
    reasons: Mapping[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        freeze_arrays(self, {}, flags=("unreachable",), others={"setpoint": len(self.setpoint.yaw)})

    @classmethod
    def none(cls, n: int) -> Self:
        """Return a plan without a setpoint for `n` agents."""
        inactive = np.zeros(n, np.bool_)
        setpoint = Setpoint(np.zeros((n, 3)), np.zeros(n), inactive)
        return cls(setpoint, Paths.none(), inactive)


@dataclass(frozen=True, slots=True)
class Truth:
    """Ground truth in the map, of a simulator or motion capture; for records only.

    Attributes:
        time: Mission time, s.
        position: (N, 3) m.
        velocity: (N, 3) m/s.
        attitude: (N, 4) unit quaternion x, y, z, w from the body to the map.
    """

    time: float
    position: Array
    velocity: Array
    attitude: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, {"position": (3,), "velocity": (3,), "attitude": (4,)})
