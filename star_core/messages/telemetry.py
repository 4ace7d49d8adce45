"""Telemetry of the agents: a transport's output of one tick."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntFlag
from functools import cache
from typing import NamedTuple, Self

import numpy as np

from star_core.errors import ContractError
from star_core.messages.arrays import Array, Mask, Rows, freeze_arrays
from star_core.messages.rotations import yaw_from_quaternion
from star_core.messages.vision import Detections, Frames


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
        refusals: Commands refused since the last tick; each fails the agent's step.
        signal: (N,) signal strength at each agent, as last reported, dBm; None without a radio.
        rebooted: (N,) whether each agent's firmware restarted since it was connected; None if
            that cannot happen. Such an agent receives no more commands.
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
    refusals: tuple[Refusal, ...] = ()
    signal: Array | None = None
    rebooted: Mask | None = None

    def __post_init__(self) -> None:
        numbers = {"position": (3,), "velocity": (3,), "attitude": (4,), "battery": (), "age": ()}
        if self.signal is not None:
            numbers["signal"] = ()
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
