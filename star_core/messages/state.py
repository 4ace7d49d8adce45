"""What passes through one tick: frozen tables with one row per agent.

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
from star_core.messages.transforms import Transform
from star_core.messages.vision import Corrections, Sightings


class AgentPhase(IntEnum):
    """Where one agent stands in its flight."""

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
        possible_travel: (N, 3) m. An agent that is no longer heard may have stopped at `position`
            or flown on, up to `position + possible_travel`. Set by the core, not by localizers;
            zero for agents that are heard, which is the default.
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
    """How the agents are: what a task may know beside the estimate.

    Attributes:
        phase: (N,) `AgentPhase`.
        battery: (N,) V; NaN where not reported.
        age: (N,) time since each agent was last heard, s.
        finder: (T,) row of the agent that found each target of the world, in the world's order; -1
            where none has.
    """

    phase: Rows
    battery: Array
    age: Array
    finder: Rows = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        freeze_arrays(self, {"battery": (), "age": ()}, integers=("phase",))
        freeze_arrays(self, {}, integers=("finder",), per="target")


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
        numbers = {"position": (3,), "velocity": (3,), "yaw": (), "speed": ()}
        freeze_arrays(self, numbers, flags=("active",))

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
        active: (N,) False where nothing is sent (grounded, taking off, landing, not heard); an
            avoider moves no such row.
    """

    velocity: Array
    yaw: Array
    active: Mask

    def __post_init__(self) -> None:
        freeze_arrays(self, {"velocity": (3,), "yaw": ()}, flags=("active",))


def with_possible_positions(
    estimate: Estimate, wanted: Setpoint, spacing: float = 0.2
) -> tuple[Estimate, Setpoint]:
    """Return both tables with further rows where agents that are not heard may be.

    The further rows stand behind those of the agents: at rest, inactive, along the stretch from
    each agent's position to the end of its `Estimate.possible_travel`. An avoider that handles them
    like any inactive agent keeps the others clear of all the places at which an agent that is no
    longer heard may be. If every agent is heard, the tables are returned as they are.

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
    """Polylines that agents are going to fly, in the map: a long table.

    Attributes:
        agent: (K,) row of the agent; the points of one agent stand together, in order.
        point: (K, 3) m.
    """

    agent: Rows
    point: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, {"point": (3,)}, integers=("agent",), per="point")


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
        freeze_arrays(self, {}, flags=("unreachable",), others={"setpoint": len(self.setpoint.yaw)})


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
        freeze_arrays(self, {"position": (3,), "velocity": (3,), "attitude": (4,)})
