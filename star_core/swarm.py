"""What passes through one tick: frozen tables with one row per agent.

Row *i* is the same agent in every table of a mission. Frames are right-handed with z up, units SI,
floats float64. Arrays are read-only: a stage that wants a changed table makes a new one with
`dataclasses.replace`. Ragged data is a long table with an agent column.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Self

import numpy as np

from star_core.errors import ContractError
from star_core.frames import Transform
from star_core.sight import Corrections, Sightings
from star_core.table import Array, Mask, Rows, settle


class AgentPhase(IntEnum):
    """Where one agent stands in its flight."""

    GROUNDED = 0
    TAKING_OFF = 1
    FLYING = 2
    LANDING = 3
    LANDED = 4
    LOST = 5  # not heard from, or not located
    EMERGENCY = 6  # tumbled, locked, crashed, or its motors were stopped


@dataclass(frozen=True, slots=True)
class Estimate:
    """Where the agents are believed to be, in the map: a localizer's answer.

    Attributes:
        time: Mission time, s.
        position: (N, 3) m.
        velocity: (N, 3) m/s.
        yaw: (N,) rad, anticlockwise from the map's x axis.
        covariance: (N, 3, 3) covariance of the position, m².
        valid: (N,) False where the row must not be flown on.
        map_from_odom: Where each agent's odometry frame lies in the map.
        sightings: Tags seen since the last tick that are no landmarks.
        corrections: What to tell the agents' own estimators.
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

    def __post_init__(self) -> None:
        n = len(self.position)
        settle(self, position=(n, 3), velocity=(n, 3), yaw=(n,), covariance=(n, 3, 3))
        settle(self, np.bool_, valid=(n,))
        if len(self.map_from_odom.yaw) != n:
            raise ContractError(
                f"Estimate.map_from_odom has {len(self.map_from_odom.yaw)} rows, expected {n}"
            )


@dataclass(frozen=True, slots=True)
class Health:
    """How the agents are: what a task may know beside the estimate.

    Attributes:
        phase: (N,) `AgentPhase`.
        battery: (N,) V; NaN where not reported.
        age: (N,) time since each agent was last heard, s.
        finder: (T,) row of the agent that found each target of the world, in the world's order; -1
            where nobody has.
    """

    phase: Rows
    battery: Array
    age: Array
    finder: Rows = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        n = len(self.phase)
        settle(self, np.int64, phase=(n,), finder=(len(self.finder),))
        settle(self, battery=(n,), age=(n,))


def among(phase: Rows, *phases: AgentPhase) -> Mask:
    """Return (N,) which agents, whose phases are (N,), are in one of some phases."""
    answer: Mask = phase == phases[0]
    for another in phases[1:]:
        answer |= phase == another
    return answer


@dataclass(frozen=True, slots=True)
class Goals:
    """Where the tasks want the agents, in the map.

    Attributes:
        position: (N, 3) m.
        velocity: (N, 3) velocity of a goal that moves, m/s: feed-forward.
        yaw: (N,) rad.
        speed: (N,) greatest speed on the way, m/s.
        active: (N,) False where there is no goal.
    """

    position: Array
    velocity: Array
    yaw: Array
    speed: Array
    active: Mask

    def __post_init__(self) -> None:
        n = len(self.position)
        settle(self, position=(n, 3), velocity=(n, 3), yaw=(n,), speed=(n,))
        settle(self, np.bool_, active=(n,))

    @classmethod
    def none(cls, n: int) -> Self:
        """No goal for any of `n` agents."""
        zero = np.zeros(n)
        return cls(np.zeros((n, 3)), np.zeros((n, 3)), zero, zero, np.zeros(n, np.bool_))


@dataclass(frozen=True, slots=True)
class Setpoint:
    """What the agents should fly until the next tick, in the map.

    Attributes:
        velocity: (N, 3) m/s.
        yaw: (N,) rad, anticlockwise from the map's x axis.
        active: (N,) False where nothing is sent (grounded, taking off, landing, lost); such a row
            does what it does, and an avoider expects nothing of it.
    """

    velocity: Array
    yaw: Array
    active: Mask

    def __post_init__(self) -> None:
        n = len(self.velocity)
        settle(self, velocity=(n, 3), yaw=(n,))
        settle(self, np.bool_, active=(n,))


@dataclass(frozen=True, slots=True)
class Paths:
    """Polylines that agents are going to fly, in the map: a long table.

    Attributes:
        agent: (K,) row of the agent; the points of one agent stand together, in order.
        point: (K, 3) m.
    """

    agent: Rows
    point: Array

    def __post_init__(self) -> None:
        k = len(self.agent)
        settle(self, np.int64, agent=(k,))
        settle(self, point=(k, 3))


@dataclass(frozen=True, slots=True)
class Plan:
    """A planner's answer.

    Attributes:
        setpoint: What to fly now.
        paths: What is left of each agent's path.
        unreachable: (N,) True where the goal cannot be reached: the step that wants it there fails.
        reasons: Why, by row, as far as the planner can say; of an agent or a place, in words.
    """

    setpoint: Setpoint
    paths: Paths
    unreachable: Mask
    reasons: Mapping[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        settle(self, np.bool_, unreachable=(len(self.setpoint.yaw),))


@dataclass(frozen=True, slots=True)
class Truth:
    """Where the agents really are, in the map: from a simulator or motion capture. Records only.

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
        n = len(self.position)
        settle(self, position=(n, 3), velocity=(n, 3), attitude=(n, 4))
