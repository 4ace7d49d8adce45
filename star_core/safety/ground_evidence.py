"""Which agents are known to be on the ground, by their reports or by what their firmware does."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows
from star_core.messages.commands import Order
from star_core.messages.telemetry import Supervisor, Telemetry
from star_core.safety.agents_in_the_way import FALL_TIME, MAX_REPORT_AGE, WATCHDOG_TIME

TAKEOFF_DELAY: Final = 2.0  # s after the command, by which a drone that takes off reports to fly
MIN_DESCENT: Final = 0.1  # m since the command, after which a landing counts as begun
LANDING_DELAY: Final = 2.0  # s after its planned end, by which a landing that has begun is over
LANDED_HEIGHT: Final = 0.1  # m, in the odometry frame
JITTER: Final = 0.005  # s, of the computed times of reports; they are at least 0.01 s apart

FLYING, ACTIVE, FINISHED = (
    int(bit)
    for bit in (
        Supervisor.FLYING,
        Supervisor.COMMANDER_ACTIVE,
        Supervisor.COMMANDER_FINISHED,
    )
)
FALLEN: Final = int(Supervisor.TUMBLED | Supervisor.LOCKED | Supervisor.CRASHED)
ON_BOARD: Final = (Order.TAKEOFF, Order.GOTO, Order.FOLLOW)  # a drone hovers after them


class GroundEvidence:
    """Collects what shows that agents are on the ground.

    An agent is down if it was never commanded to take off and never reported to fly, or if its
    newest report shows that it is on the ground. One that is not heard any more counts as down in
    two cases, in which its firmware ends the flight without a link:

    * Its reports showed that setpoints flew it, and `WATCHDOG_TIME` and `FALL_TIME` have passed
      since the last one: its watchdog has stopped its motors.
    * Its reports showed that a landing had begun, and `LANDING_DELAY` has passed since the planned
      end of that.

    In all other cases it may be in the air: after a take-off, a go-to or a trajectory, a drone
    hovers until its battery is empty, or until its own descent. The announced end of that,
    `Telemetry.lands_by`, is no evidence: a drone that has come down so stands with its motors on,
    which is a danger until they are stopped, and that it heard the command is not known if the link
    was lost at the beginning.

    Attributes:
        land_until: (N,) planned end of each agent's last landing, s.
        steered_seen: (N,) whether a report showed that setpoints flew each agent, since it was last
            commanded to fly on board.
    """

    def __init__(self, n: int) -> None:
        self._flew = np.zeros(n, np.bool_)  # or may have
        self._reported = np.full(n, -np.inf)  # s, time of the newest report
        self._state = np.zeros(n, np.int64)  # bits of `Supervisor` in it
        self._height = np.full(n, np.nan)  # m, in it
        self._valid_from = np.full(n, -np.inf)  # s; earlier reports do not show the last command
        self._lands = np.zeros(n, np.bool_)  # whether the last command was to land
        self._stops = np.zeros(n, np.bool_)  # whether it was to stop the motors
        self._top = np.full(n, np.nan)  # m, greatest height since it was commanded to land
        self.land_until = np.full(n, -np.inf)  # s, planned end
        self._landing_seen = np.zeros(n, np.bool_)
        self._steered_since = np.full(n, np.inf)  # s, first setpoint since the last command
        self._steered_at = np.full(n, -np.inf)  # s, last setpoint
        self.steered_seen = np.zeros(n, np.bool_)

    def steered(self, time: float, active: Mask) -> None:
        """Note at a time, s, which agents setpoints are sent to: (N,)."""
        self._steered_at[active] = time
        self._steered_since[active] = np.fmin(self._steered_since[active], time)
        self._lands &= ~active
        self._stops &= ~active

    def commanded(self, time: float, order: Order, rows: Rows, until: Array) -> None:
        """Note a command that is sent to some rows at a time, s, with its planned ends: (K,) s."""
        if order is Order.ARM:
            return
        self._lands[rows], self._stops[rows] = order is Order.LAND, order is Order.STOP
        self._landing_seen[rows] = False
        self._steered_since[rows] = np.inf
        if order in ON_BOARD:
            self._flew[rows] = True
            self.steered_seen[rows] = False
            self._valid_from[rows] = time + TAKEOFF_DELAY
        elif order is Order.LAND:
            self._top[rows] = self._height[rows]
            self.land_until[rows] = until

    def observe(self, time: float, telemetry: Telemetry) -> None:
        """Note the reports of a tick at a time, s."""
        at = time - telemetry.age
        new = at > self._reported + JITTER
        self._reported = np.where(new, at, self._reported)
        self._state = np.where(new, telemetry.state, self._state)
        self._height = np.where(new, telemetry.position[:, 2], self._height)
        self._top = np.fmax(self._top, self._height)
        flies = new & (self._state & FLYING != 0)
        self._flew |= flies
        on_board = self._state & ACTIVE != 0
        self.steered_seen |= flies & ~on_board & (at > self._steered_since + JITTER)
        descends = (self._state & FINISHED == 0) & (self._height < self._top - MIN_DESCENT)
        self._landing_seen |= flies & on_board & descends & self._lands

    def heard(self, time: float) -> Mask:
        """Return which agents have reported lately, at a time, s: (N,)."""
        heard: Mask = time - self._reported <= MAX_REPORT_AGE
        return heard

    def down(self, time: float) -> Mask:
        """Return which agents are known to be on the ground at a time, s: (N,)."""
        landed = self._state & (ACTIVE | FINISHED) == FINISHED  # otherwise its motors are on
        low = landed & (self._height < LANDED_HEIGHT) & self._lands
        reports = (self._state & FLYING == 0) | (self._state & FALLEN != 0) | low
        reports &= self._reported >= self._valid_from
        down: Mask = ~self._flew | reports | self.assumed_down(time)
        return down

    def assumed_down(self, time: float) -> Mask:
        """Return which agents are down although no report shows it: (N,)."""
        return ~self.heard(time) & (self._stopped(time) | self._landed(time))

    def stop_unconfirmed(self, time: float) -> Mask:
        """Return which agents were commanded to stop their motors, and may fly yet: (N,)."""
        return self._stops & ~self.down(time)

    def describe(self, row: int, time: float) -> str:
        """Return what is known of an agent, for messages: ``not heard for 3.1 s``, for example."""
        height = self._height[row]
        at = f" at {height:.2f} m" if np.isfinite(height) else ""
        if self.heard(time)[row]:
            return f"it reports to fly{at}"
        if not np.isfinite(self._reported[row]):
            return "it was never heard"
        silent = f"not heard for {time - self._reported[row]:.1f} s"
        if self._stopped(time)[row]:
            return f"{silent}: down, at the latest by its own watchdog"
        if self._landed(time)[row]:
            return f"{silent}: its landing had begun, and is over"
        return f"{silent}, last{at}" if at else silent

    def _stopped(self, time: float) -> Mask:
        """Return which agents' watchdogs have stopped their motors if they hear nothing: (N,)."""
        stopped = self.steered_seen & (time >= self._steered_at + WATCHDOG_TIME + FALL_TIME)
        over: Mask = stopped & (~self._lands | (time >= self.land_until))
        return over

    def _landed(self, time: float) -> Mask:
        """Return which agents have ended a landing that was seen to begin: (N,)."""
        landed: Mask = self._landing_seen & (time >= self.land_until + LANDING_DELAY)
        return landed
