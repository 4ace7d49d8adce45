"""A transport of stubs that follow every setpoint and order exactly."""

from __future__ import annotations

import numpy as np

import star_core as star
from star_core import Order, Supervisor

PATIENCE = 600  # ticks: a minute, more than any mission here takes
SOON = 1e-9  # s: ticks are sums of periods


class Robots:
    """A transport to points: velocities at once, on-board orders along straight lines.

    Attributes:
        commands: Every command, with the mission time it came at.
        sent: Every setpoint, with the mission time it came at.
        corrected: Corrections of on-board estimators.
    """

    def __init__(self, frames: star.Transform) -> None:
        n = len(frames.yaw)
        self.commands: list[tuple[float, star.Command]] = []
        self.sent: list[tuple[float, star.Setpoint]] = []
        self.corrected: list[star.Corrections] = []
        self._frames = frames
        self._waits = 0
        self._time = 0.0
        self._position = np.zeros((n, 3))  # each in its own odometry frame
        self._velocity = np.zeros((n, 3))
        self._yaw = np.zeros(n)
        self._state = np.zeros(n, np.int64)
        self._target = np.zeros((n, 3))  # of the commander
        self._after = np.zeros(n, np.int64)  # what the state is when the commander is there
        self._over = np.full(n, np.inf)  # s, when that is

    def connect(self) -> None: ...

    def correct(self, corrections: star.Corrections) -> None:
        self.corrected.append(corrections)

    def wait(self, until: float) -> float:
        self._waits += 1
        if self._waits > PATIENCE:
            raise RuntimeError("the flight does not end")
        left = np.maximum(self._over - self._time, SOON)
        share = np.where(np.isfinite(left), np.minimum((until - self._time) / left, 1.0), 0.0)
        self._position += (until - self._time) * self._velocity
        self._position += share[:, None] * (self._target - self._position)
        self._time = until
        there = self._over <= until + SOON
        self._position[there] = self._target[there]
        self._state[there] = self._after[there]
        self._over[there] = np.inf
        return until

    def receive(self) -> star.Telemetry:
        half = self._yaw / 2
        return star.Telemetry(
            time=self._time,
            position=self._position,
            velocity=self._velocity,
            attitude=np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1),
            battery=np.full(len(half), 4.0),
            state=self._state,
            age=np.zeros(len(half)),
        )

    def command(self, command: star.Command) -> None:
        self.commands.append((self._time, command))
        rows, order = command.agent, command.order
        up, done = int(Supervisor.FLYING), int(Supervisor.COMMANDER_FINISHED)
        self._velocity[rows] = 0.0
        self._state[rows] = 0 if order is Order.STOP else up
        self._over[rows] = np.inf if order is Order.STOP else self._time + command.duration
        self._after[rows] = done if order is Order.LAND else up | done
        self._target[rows] = self._position[rows]
        self._target[rows, 2] = np.maximum(command.position[:, 2], 0.0)  # the floor
        if order is Order.GOTO:
            self._target[rows] = command.position
            self._yaw[rows] = command.yaw

    def send(self, setpoint: star.Setpoint) -> star.Setpoint:
        self.sent.append((self._time, setpoint))
        self._velocity = np.where(setpoint.active[:, None], setpoint.velocity, 0.0)
        self._yaw = np.where(setpoint.active, setpoint.yaw, self._yaw)
        return setpoint

    def truth(self) -> star.Truth | None:
        attitude = np.tile([0.0, 0.0, 0.0, 1.0], (len(self._yaw), 1))
        return star.Truth(self._time, self._frames.apply(self._position), self._velocity, attitude)
