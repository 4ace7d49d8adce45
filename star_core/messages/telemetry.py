"""Telemetry of the agents, a transport's output of one tick, and tables of images and tags."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from enum import IntFlag
from functools import cache
from typing import Any, Final, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from star_core.errors import ContractError
from star_core.messages.arrays import Array, Mask, Rows, freeze_arrays
from star_core.messages.rotations import yaw_from_quaternion

Image: TypeAlias = NDArray[np.uint8]
"""(height, width) grey values."""


class Supervisor(IntFlag):
    """Bits of `Telemetry.state`, as the Crazyflie firmware's supervisor reports them."""

    CAN_ARM = 1
    ARMED = 2
    AUTO_ARM = 4
    CAN_FLY = 8
    FLYING = 16  # stays set for 2 s after the motors were last above idle
    TUMBLED = 32
    LOCKED = 64
    CRASHED = 128
    COMMANDER_ACTIVE = 256  # the high-level commander flies
    COMMANDER_FINISHED = 512  # the high-level commander's last trajectory is over
    COMMANDER_DISABLED = 1024  # the high-level commander sends no setpoints
    DECK_FAULT = 2048  # an expansion deck reports a fault; in flight the motors are stopped


EMERGENCIES: Final = {
    Supervisor.DECK_FAULT: "deck fault",
    Supervisor.LOCKED: "locked until a reboot",
    Supervisor.CRASHED: "crashed, needs crash recovery",
    Supervisor.TUMBLED: "tumbled",
}
"""Bits with which an agent cannot fly on, and what they mean."""


def emergency(state: int) -> str:
    """Return why an agent with these bits of `Supervisor` cannot fly on; empty if it can.

    >>> emergency(Supervisor.CAN_FLY | Supervisor.FLYING)
    ''
    >>> emergency(Supervisor.LOCKED | Supervisor.TUMBLED)
    'locked until a reboot, tumbled'
    """
    return ", ".join(text for bit, text in EMERGENCIES.items() if state & bit)


def merged(tables: Iterable[Any], none: Any) -> Any:
    """Return the rows of several tables, in order; `none` if there is none."""
    filled = [table for table in tables if len(table.agent)]
    if len(filled) <= 1:
        return filled[0] if filled else none
    names = [field.name for field in fields(none)]
    columns: Any = (np.concatenate([getattr(table, name) for table in filled]) for name in names)
    return type(none)(*columns)


@dataclass(frozen=True, slots=True)
class Odometry:
    """Samples of the on-board estimators since the last tick: one row each, up to 100 Hz.

    Attributes:
        agent: (K,) row of the agent that sent the sample.
        time: (K,) mission time of the sample, s.
        velocity: (K, 3) velocity in the leveled body frame (x forward, z up), m/s.
        yaw_rate: (K,) rad/s.
        roll: (K,) rad.
        pitch: (K,) rad, nose down positive (right-handed about y).
        height: (K,) z in the agent's odometry frame, m.
    """

    agent: Rows
    time: Array
    velocity: Array
    yaw_rate: Array
    roll: Array
    pitch: Array
    height: Array

    def __post_init__(self) -> None:
        freeze_arrays(
            self,
            {
                "time": (),
                "velocity": (3,),
                "yaw_rate": (),
                "roll": (),
                "pitch": (),
                "height": (),
            },
            integers=("agent",),
            per="sample",
        )

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without a sample."""
        nothing = np.zeros(0)
        return cls(
            np.zeros(0, np.int64), nothing, np.zeros((0, 3)), nothing, nothing, nothing, nothing
        )


@dataclass(frozen=True, slots=True)
class Frames:
    """Images that arrived since the last tick, in the order of their arrival.

    Attributes:
        agent: (K,) row of the agent whose camera took it.
        taken: (K,) mission time at the middle of the exposure of its middle row, s; NaN if unknown.
        arrived: (K,) mission time of its arrival, s.
        image: K images; each has the size of its camera.
    """

    agent: Rows
    taken: Array
    arrived: Array
    image: tuple[Image, ...]

    def __post_init__(self) -> None:
        images = {"image": len(self.image)}
        numbers: dict[str, tuple[int, ...]] = {"taken": (), "arrived": ()}
        freeze_arrays(self, numbers, integers=("agent",), others=images, per="image")

    @property
    def time(self) -> Array:
        """(K,) `taken`, or `arrived` where that is unknown, s."""
        return np.where(np.isfinite(self.taken), self.taken, self.arrived)

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without an image."""
        return cls(np.zeros(0, np.int64), np.zeros(0), np.zeros(0), ())


@dataclass(frozen=True, slots=True)
class Detections:
    """Tags detected in images, by a camera's own processor or by the localizer.

    Attributes:
        agent: (K,) row of the agent whose camera saw the tag.
        tag: (K,) the tag's number.
        corners: (K, 4, 2) its corners in the distorted image, px: bottom left, bottom right, top
            right and top left of the upright tag.
        taken: (K,) of the image, as in `Frames`.
        arrived: (K,) of the image, as in `Frames`.
        rejected: K reasons for which the localizer did not use a tag; empty texts for those that it
            used, which is the default.
    """

    agent: Rows
    tag: Rows
    corners: Array
    taken: Array
    arrived: Array
    rejected: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        reasons = tuple(map(str, self.rejected))
        others = {"rejected": len(reasons)} if reasons else {}
        numbers = {"corners": (4, 2), "taken": (), "arrived": ()}
        freeze_arrays(self, numbers, integers=("agent", "tag"), others=others, per="tag")
        object.__setattr__(self, "rejected", reasons or ("",) * len(self.tag))

    @property
    def time(self) -> Array:
        """(K,) `taken`, or `arrived` where that is unknown, s: equal to that of the image."""
        return np.where(np.isfinite(self.taken), self.taken, self.arrived)

    @classmethod
    def merged(cls, tables: Iterable[Self]) -> Self:
        """Return the rows of several tables, in order."""
        table: Self = merged(tables, cls.none())
        return table

    def of(self, rows: Rows | Mask) -> Self:
        """Return some rows, (K,)."""
        columns: Any = (np.array(getattr(self, field.name))[rows] for field in fields(self))
        return type(self)(*columns)

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without a tag."""
        none = np.zeros(0, np.int64)
        return cls(none, none, np.zeros((0, 4, 2)), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, slots=True)
class PoseFixes:
    """Poses of agents in the map, as a positioning system measured them.

    Attributes:
        agent: (K,) row of the agent.
        taken: (K,) mission time of the measurement, s; NaN if unknown.
        arrived: (K,) mission time of its arrival, s.
        position: (K, 3) map frame, m.
        attitude: (K, 4) unit quaternion x, y, z, w from the body to the map; NaN if not measured.
        position_std: (K,) standard deviation along each axis, m.
        attitude_std: (K,) standard deviation about each axis, rad.
        correlation_time: (K,) time constant with which the error of the position changes, s; 0 if
            those of two measurements are independent.
    """

    agent: Rows
    taken: Array
    arrived: Array
    position: Array
    attitude: Array
    position_std: Array
    attitude_std: Array
    correlation_time: Array

    def __post_init__(self) -> None:
        freeze_arrays(
            self,
            {
                "taken": (),
                "arrived": (),
                "position": (3,),
                "attitude": (4,),
                "position_std": (),
                "attitude_std": (),
                "correlation_time": (),
            },
            integers=("agent",),
            per="fix",
        )

    @property
    def time(self) -> Array:
        """(K,) `taken`, or `arrived` where that is unknown, s."""
        return np.where(np.isfinite(self.taken), self.taken, self.arrived)

    @classmethod
    def merged(cls, tables: Iterable[Self]) -> Self:
        """Return the rows of several tables, in order."""
        table: Self = merged(tables, cls.none())
        return table

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without a fix."""
        nothing = np.zeros(0)
        vectors, turns = np.zeros((0, 3)), np.zeros((0, 4))
        return cls(np.zeros(0, np.int64), nothing, nothing, vectors, turns, *[nothing] * 3)


@dataclass(frozen=True, slots=True)
class Sightings:
    """Tags seen by agents that are not landmarks: targets.

    Attributes:
        agent: (K,) row of the agent that saw the tag.
        tag: (K,) the tag's number.
        time: (K,) mission time of the sighting, s.
        position: (K, 3) center of the tag in the map, m.
        yaw: (K,) direction of the tag's x axis in the map's x-y plane, rad.
        covariance: (K, 3, 3) of the position, including that of the agent's position, m².
    """

    agent: Rows
    tag: Rows
    time: Array
    position: Array
    yaw: Array
    covariance: Array

    def __post_init__(self) -> None:
        numbers = {"time": (), "position": (3,), "yaw": (), "covariance": (3, 3)}
        freeze_arrays(self, numbers, integers=("agent", "tag"), per="tag")

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without a tag."""
        none, empty = np.zeros(0, np.int64), np.zeros(0)
        return cls(none, none, empty, np.zeros((0, 3)), empty, np.zeros((0, 3, 3)))


@dataclass(frozen=True, slots=True)
class Corrections:
    """Poses of agents in their odometry frames, for their on-board estimators.

    Attributes:
        agent: (K,) row of the agent.
        position: (K, 3) m.
        attitude: (K, 4) unit quaternion x, y, z, w from the body to the odometry frame.
        position_deviation: (K,) along each axis, m.
        attitude_deviation: (K,) about each axis, rad; infinite if only the position is corrected.
    """

    agent: Rows
    position: Array
    attitude: Array
    position_deviation: Array
    attitude_deviation: Array

    def __post_init__(self) -> None:
        freeze_arrays(
            self,
            {
                "position": (3,),
                "attitude": (4,),
                "position_deviation": (),
                "attitude_deviation": (),
            },
            integers=("agent",),
            per="correction",
        )

    @classmethod
    @cache  # tables are read-only
    def none(cls) -> Self:
        """Return a table without a correction."""
        nothing = np.zeros(0)
        return cls(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 4)), nothing, nothing)


class Refusal(NamedTuple):
    """A command that an agent refused.

    Attributes:
        agent: Row of the agent.
        reason: The command and the reason, in words that follow its name: "refuses to ...".
    """

    agent: int
    reason: str


@dataclass(frozen=True, slots=True)
class Telemetry:
    """Telemetry of each agent in its own odometry frame. NaN means "not reported".

    An agent's odometry frame has its origin at the agent's position when its estimator was started,
    level, with x along its heading; it drifts from there in flight.

    Attributes:
        time: Mission time of the newest row, s.
        position: (N, 3) m.
        velocity: (N, 3) m/s.
        attitude: (N, 4) unit quaternion x, y, z, w from the body to the odometry frame.
        battery: (N,) V.
        state: (N,) bits of `Supervisor`.
        age: (N,) time since each agent was last heard, s.
        odometry: Samples since the last tick.
        frames: Images since the last tick.
        detections: Tags detected on board since the last tick.
        fixes: Poses measured by a positioning system since the last tick.
        refusals: Commands refused since the last tick; each fails the agent's step.
        signal: (N,) signal strength at each agent, as last reported, dBm; None without a radio.
        rebooted: (N,) whether each agent's firmware restarted since it was connected; None if
            that cannot happen. Such an agent receives no more commands.
        lands_by: (N,) mission time by which the last climb or trajectory that each agent was
            commanded to fly on board ends on the ground if nothing takes over from it, s: infinite
            if it hovers instead. None if no such flight ends on the ground.
    """

    time: float
    position: Array
    velocity: Array
    attitude: Array
    battery: Array
    state: Rows
    age: Array
    odometry: Odometry = field(default_factory=Odometry.none)
    frames: Frames = field(default_factory=Frames.none)
    detections: Detections = field(default_factory=Detections.none)
    fixes: PoseFixes = field(default_factory=PoseFixes.none)
    refusals: tuple[Refusal, ...] = ()
    signal: Array | None = None
    rebooted: Mask | None = None
    lands_by: Array | None = None

    def __post_init__(self) -> None:
        numbers = {"position": (3,), "velocity": (3,), "attitude": (4,), "battery": (), "age": ()}
        numbers |= {name: () for name in ("signal", "lands_by") if getattr(self, name) is not None}
        flags = () if self.rebooted is None else ("rebooted",)
        freeze_arrays(self, numbers, flags=flags, integers=("state",))
        n = len(self.position)
        for agent, _reason in self.refusals:
            if not 0 <= agent < n:
                raise ContractError(f"Telemetry.refusals has agent {agent!r} of {n}")

    @property
    def heading(self) -> Array:
        """(N,) yaw of each agent in its odometry frame, rad, from -pi to pi."""
        yaw: Array = yaw_from_quaternion(self.attitude)
        return yaw
