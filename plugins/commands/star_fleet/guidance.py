"""Arbitration between the high-level commander and external setpoints.

As in the firmware's ``commander.c``: an external setpoint takes the priority from the high-level
commander and stops its plan; it keeps the priority, even without further setpoints, until a packet
releases it. A plan that is started meanwhile is accepted and runs, but does not reach the motors.
"""

from __future__ import annotations

import math

from star_fleet.craft import Craft
from star_fleet.highlevel import HighLevel
from star_fleet.setpoints import Demand


class Guidance:
    """Passes the active reference to the position loop.

    Args:
        craft: The vehicle's craft.
        high_level: Its high-level commander.
    """

    def __init__(self, craft: Craft, high_level: HighLevel) -> None:
        self._craft, self._high_level = craft, high_level
        self._demand: Demand | None = None  # None: the high-level commander has the priority
        self._stamp = 0.0  # s, when the demand came
        self._levels = False
        self._allowed = False
        self._until = math.inf  # s, when the plan's next piece begins

    @property
    def allowed(self) -> bool:
        """Whether the supervisor lets the motors run."""
        return self._allowed

    def silence(self, now: float) -> float:
        """Time without a setpoint, s; 0 while the high-level commander has the priority."""
        return 0.0 if self._demand is None else now - self._stamp

    def stream(self, demand: Demand, now: float) -> None:
        """Fly an external setpoint at `now`, s."""
        self._demand, self._stamp = demand, now
        self._high_level.stop()
        self._steer(now)

    def let_go(self, now: float) -> None:
        """Return the priority to the high-level commander at `now`, s."""
        self._demand = None
        self._steer(now)

    def obey(self, payload: bytes, now: float) -> bytes:
        """Carry out a command to the high-level commander, and return the answer."""
        before = self._high_level.plan(now)
        answer = self._high_level.obey(payload, now, blocked=not self._allowed)
        if self._demand is None and self._high_level.plan(now) is not before:
            self._steer(now)
        return answer

    def permit(self, now: float, *, allowed: bool, levels: bool) -> None:
        """Apply the supervisor's decisions at `now`, s: motors allowed, level out."""
        if (allowed, levels) == (self._allowed, self._levels):
            return
        if not allowed:
            self._high_level.stop()
        self._allowed, self._levels = allowed, levels
        self._steer(now)

    def advance(self, now: float) -> None:
        """Start the plan's next piece if it is due at `now`, s."""
        if now >= self._until:
            self._steer(now)

    def _steer(self, now: float) -> None:
        self._until = math.inf
        if not self._allowed:
            self._craft.stop()
        elif self._demand is not None:
            self._craft.demand(self._demand.levelled() if self._levels else self._demand)
        elif (current := self._high_level.piece(now)) is None:
            self._craft.stop()
        else:
            piece, began, lands, self._until = current
            self._craft.follow(piece, began, lands=lands)
