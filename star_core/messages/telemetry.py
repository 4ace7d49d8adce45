"""Telemetry of the agents, a transport's output of one tick, and tables of images and tags."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import field, fields
from enum import IntFlag
from typing import Any, Final, NamedTuple, Self, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from star_core.errors import ContractError
from star_core.messages.arrays import (
    Array,
    Mask,
    Rows,
    Table,
    column,
    counted,
    row_count_error,
    table,
)
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


class Items(Table):
    """A table with a row for each item, of any agents."""

    __slots__ = ()
    agent: Rows

    @classmethod
    def merged(cls, tables: Iterable[Self]) -> Self:
        """Return the rows of several tables, in order."""
        filled = [table for table in tables if len(table.agent)]
        if len(filled) <= 1:
            return filled[0] if filled else cls.none()
        names = [field.name for field in fields(cast("Any", cls))]
        columns = (np.concatenate([getattr(table, name) for table in filled]) for name in names)
        return cls(*columns)

    def of(self, rows: Rows | Mask) -> Self:
        """Return some rows, (K,)."""
        names = [field.name for field in fields(cast("Any", self))]
        return type(self)(*(np.array(getattr(self, name))[rows] for name in names))


class Timed(Items):
    """A table of what was taken at one time, and arrived at another."""

    __slots__ = ()
    taken: Array
    arrived: Array

    @property
    def time(self) -> Array:
        """(K,) `taken`, or `arrived` where that is unknown, s."""
        return np.where(np.isfinite(self.taken), self.taken, self.arrived)


@table(per="sample")
class Odometry(Items):
    """Samples of the on-board estimators since the last tick: one row each, up to 100 Hz.

    Attributes:
        agent: Row of the agent that sent the sample.
        time: Mission time of the sample, s.
        velocity: Velocity in the leveled body frame (x forward, z up), m/s.
        yaw_rate: rad/s.
        roll: rad.
        pitch: rad, nose down positive (right-handed about y).
        height: z in the agent's odometry frame, m.
    """

    agent: Rows = column()
    time: Array = column()
    velocity: Array = column(3)
    yaw_rate: Array = column()
    roll: Array = column()
    pitch: Array = column()
    height: Array = column()


@table(per="image")
class Frames(Timed):
    """Images that arrived since the last tick, in the order of their arrival.

    Attributes:
        agent: Row of the agent whose camera took it.
        taken: Mission time at the middle of the exposure of its middle row, s; NaN if unknown.
        arrived: Mission time of its arrival, s.
        image: K images; each has the size of its camera.
    """

    agent: Rows = column()
    taken: Array = column()
    arrived: Array = column()
    image: tuple[Image, ...] = counted(default=())


@table(per="tag")
class Detections(Timed):
    """Tags detected in images, by a camera's own processor or by the localizer.

    Attributes:
        agent: Row of the agent whose camera saw the tag.
        tag: The tag's number.
        corners: Its corners in the distorted image, px: bottom left, bottom right, top
            right and top left of the upright tag.
        taken: Of the image, as in `Frames`.
        arrived: Of the image, as in `Frames`.
        rejected: K reasons for which the localizer did not use a tag; empty texts for those that it
            used, which is the default.
    """

    agent: Rows = column()
    tag: Rows = column()
    corners: Array = column(4, 2)
    taken: Array = column()
    arrived: Array = column()
    rejected: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        Table.__post_init__(self)  # `slots` makes another class, which breaks `super()`
        reasons = tuple(map(str, self.rejected)) or ("",) * len(self.tag)
        if len(reasons) != len(self.tag):
            counts = {"tag": len(self.tag), "rejected": len(reasons)}
            raise row_count_error("Detections", counts, "tag")
        object.__setattr__(self, "rejected", reasons)


UNLABELLED: Final = -1
"""`PoseFixes.agent` of a marker that may be any agent's."""


@table(per="fix")
class PoseFixes(Timed):
    """Poses of agents in the map, as a positioning system measured them.

    Attributes:
        agent: Row of the agent; `UNLABELLED` if the system does not know whose marker it sees.
        taken: Mission time of the measurement, s; NaN if unknown.
        arrived: Mission time of its arrival, s.
        position: Map frame, m.
        attitude: Unit quaternion x, y, z, w from the body to the map; NaN if not measured.
        position_std: Standard deviation along each axis, m.
        attitude_std: Standard deviation about each axis, rad.
        correlation_time: Time constant with which the error of the position changes, s; 0 if
            those of two measurements are independent.
    """

    agent: Rows = column()
    taken: Array = column()
    arrived: Array = column()
    position: Array = column(3)
    attitude: Array = column(4)
    position_std: Array = column()
    attitude_std: Array = column()
    correlation_time: Array = column()


@table(per="tag")
class Sightings(Table):
    """Tags seen by agents that are not landmarks: targets.

    Attributes:
        agent: Row of the agent that saw the tag.
        tag: The tag's number.
        time: Mission time of the sighting, s.
        position: Center of the tag in the map, m.
        yaw: Direction of the tag's x axis in the map's x-y plane, rad.
        covariance: Of the position, including that of the agent's position, m².
    """

    agent: Rows = column()
    tag: Rows = column()
    time: Array = column()
    position: Array = column(3)
    yaw: Array = column()
    covariance: Array = column(3, 3)


@table(per="correction")
class Corrections(Table):
    """Poses of agents in their odometry frames, for their on-board estimators.

    Attributes:
        agent: Row of the agent.
        position: m.
        attitude: Unit quaternion x, y, z, w from the body to the odometry frame.
        position_deviation: Along each axis, m.
        attitude_deviation: About each axis, rad; infinite if only the position is corrected.
    """

    agent: Rows = column()
    position: Array = column(3)
    attitude: Array = column(4)
    position_deviation: Array = column()
    attitude_deviation: Array = column()


class Refusal(NamedTuple):
    """A command that an agent refused.

    Attributes:
        agent: Row of the agent.
        reason: The command and the reason, in words that follow its name: "refuses to ...".
    """

    agent: int
    reason: str


@table()
class Telemetry(Table):
    """Telemetry of each agent in its own odometry frame. NaN means "not reported".

    An agent's odometry frame has its origin at the agent's position when its estimator was started,
    level, with x along its heading; it drifts from there in flight.

    Attributes:
        time: Mission time of the newest row, s.
        position: m.
        velocity: m/s.
        attitude: Unit quaternion x, y, z, w from the body to the odometry frame.
        battery: V.
        state: Bits of `Supervisor`.
        age: Time since each agent was last heard, s.
        odometry: Samples since the last tick.
        frames: Images since the last tick.
        detections: Tags detected on board since the last tick.
        fixes: Poses measured by a positioning system since the last tick.
        refusals: Commands refused since the last tick; each fails the agent's step.
        signal: Signal strength at each agent, as last reported, dBm; None without a radio.
        rebooted: Whether each agent's firmware restarted since it was connected; None if
            that cannot happen. Such an agent receives no more commands.
        lands_by: Mission time by which the last climb or trajectory that each agent was
            commanded to fly on board ends on the ground if nothing takes over from it, s: infinite
            if it hovers instead. None if no such flight ends on the ground.
        specific_force: What each agent's accelerometer measures along x and y of its body,
            m/s²: the drag of the air, since propellers push along z. None without accelerometers.
        position_variance: Variance of `position` along each axis that the on-board estimators
            report, m²; None if they report none.
    """

    time: float
    position: Array = column(3)
    velocity: Array = column(3)
    attitude: Array = column(4)
    battery: Array = column()
    state: Rows = column()
    age: Array = column()
    odometry: Odometry = field(default_factory=Odometry.none)
    frames: Frames = field(default_factory=Frames.none)
    detections: Detections = field(default_factory=Detections.none)
    fixes: PoseFixes = field(default_factory=PoseFixes.none)
    refusals: tuple[Refusal, ...] = ()
    signal: Array | None = column(default=None)
    rebooted: Mask | None = column(default=None)
    lands_by: Array | None = column(default=None)
    specific_force: Array | None = column(2, default=None)
    position_variance: Array | None = column(3, default=None)

    def __post_init__(self) -> None:
        Table.__post_init__(self)
        n = len(self.position)
        for agent, _reason in self.refusals:
            if not 0 <= agent < n:
                raise ContractError(f"Telemetry.refusals has agent {agent!r} of {n}")

    @property
    def heading(self) -> Array:
        """(N,) yaw of each agent in its odometry frame, rad, from -pi to pi."""
        yaw: Array = yaw_from_quaternion(self.attitude)
        return yaw
