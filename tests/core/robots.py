"""A transport to points that keeps all that it was sent."""

from __future__ import annotations

import numpy as np

import star_core as star
from star_core import Command, Order
from star_core.testing import PointMasses

PATIENCE = 600  # ticks: a minute, more than any mission here takes
SOON = 1e-9  # s: ticks are sums of periods


class Robots(PointMasses):
    """Point masses at the origins of their odometry frames; trajectories they hover through.

    Attributes:
        commands: Every command, with the mission time it came at.
        sent: Every setpoint, with the mission time it came at.
        corrected: Corrections of on-board estimators.
    """

    def __init__(self, frames: star.Transform) -> None:
        super().__init__(np.zeros((len(frames.yaw), 3)), frames=frames)
        self.commands: list[tuple[float, star.Command]] = []
        self.sent: list[tuple[float, star.Setpoint]] = []
        self.corrected: list[star.Corrections] = []
        self._waits = 0

    def correct(self, corrections: star.Corrections) -> None:
        self.corrected.append(corrections)

    def wait(self, until: float) -> float:
        self._waits += 1
        if self._waits > PATIENCE:
            raise RuntimeError("the flight does not end")
        return super().wait(until)

    def command(self, command: star.Command) -> None:
        self.commands.append((self.time, command))
        if command.order is Order.FOLLOW:
            position = self.position[command.agent]
            command = Command(Order.GOTO, command.agent, position, command.yaw, command.duration)
        super().command(command)

    def send(self, setpoint: star.Setpoint) -> star.Setpoint:
        self.sent.append((self.time, setpoint))
        return super().send(setpoint)
