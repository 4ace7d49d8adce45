"""Commands landings again until the drones are known to be down."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from star_core import Mask, Order, Telemetry
from star_core.toolkit import GroundEvidence
from star_radio import orders
from star_radio.report import LANDED_HEIGHT
from star_radio.vehicle import Vehicle, landing_time

REPEAT_PERIOD: Final = 1.0  # s, between two commands to a drone that does not descend
FLYING_TIME: Final = 3.0  # s, for which a drone reports to fly after a landing: 2 s by its firmware
DESCENDS: Final = 0.05  # m/s, downward


class Landings:
    """Lands drones in place, and stops the motors of those that were commanded to.

    A drone that is heard, may be in the air and does not descend receives its last command again
    every `REPEAT_PERIOD`: one whose link returns, for example. One that is low, or at an unknown
    height, may be landing; if it reports to fly long after the end of that, it stands with its
    motors on. One that is not heard receives none, since it may have landed, and another landing
    would start its motors.

    Args:
        cancel: Forgets what drones were commanded to fly.
    """

    def __init__(
        self,
        vehicles: Sequence[Vehicle],
        ground: GroundEvidence,
        cancel: Callable[[Sequence[int]], object] = lambda _rows: None,
    ) -> None:
        self._vehicles, self._ground, self._cancel = vehicles, ground, cancel
        self._due = np.zeros(len(vehicles))  # s, of the next command to each

    def land(self, row: int, height: float) -> None:
        """Command a drone to land from a height, m; NaN if unknown."""
        now = time.monotonic()
        self._cancel([row])
        self._vehicles[row].land()
        until = np.array([now + landing_time(height)])
        self._ground.commanded(now, Order.LAND, np.array([row]), until)
        self._due[row] = now + REPEAT_PERIOD

    def repeat(self, telemetry: Telemetry, aloft: Mask) -> list[int]:
        """Command drones again that were commanded and may be in the air; return their rows."""
        now = time.monotonic()
        height = telemetry.position[:, 2]
        lands = ~(height >= LANDED_HEIGHT) | (telemetry.velocity[:, 2] < -DESCENDS)
        lands &= now < self._ground.land_until + FLYING_TIME
        waits = ~self._ground.heard(now) | (now < self._due)
        repeated = []
        for row in np.flatnonzero(aloft & ~waits).tolist():
            vehicle = self._vehicles[row]
            if vehicle.stopped:
                vehicle.order(orders.stop(), "stop")
                self._due[row] = now + REPEAT_PERIOD
            elif vehicle.lands and vehicle.airborne and not lands[row]:
                self.land(row, float(height[row]))
            else:
                continue
            repeated.append(row)
        return repeated
