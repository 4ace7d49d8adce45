"""Which agents are known to be on the ground, by their reports or by what their firmware does."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from star_core.messages.arrays import Array, Mask, Rows, frozen
from star_core.messages.commands import Order
from star_core.messages.telemetry import Supervisor, Telemetry
from star_core.safety.agents_in_the_way import FALL_TIME, MAX_REPORT_AGE, WATCHDOG_TIME
from star_core.toolkit.jit import compiled

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
        self._land_until = np.full(n, -np.inf)  # s, planned end
        self._landing_seen = np.zeros(n, np.bool_)
        self._steered_since = np.full(n, np.inf)  # s, first setpoint since the last command
        self._steered_at = np.full(n, -np.inf)  # s, last setpoint
        self.steered_seen = np.zeros(n, np.bool_)
        nothing = np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 3))
        self._note(0.0, *map(frozen, nothing))  # compiled before the flight

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
            self._land_until[rows] = until

    def observe(self, time: float, telemetry: Telemetry) -> None:
        """Note the reports of a tick at a time, s."""
        self._note(time, telemetry.age, telemetry.state, telemetry.position)

    def _note(self, *reports: Any) -> None:
        note(  # type: ignore[call-arg]  # those that it has
            *reports,
            self._reported,
            self._state,
            self._height,
            self._top,
            self._flew,
            self.steered_seen,
            self._steered_since,
            self._lands,
            self._landing_seen,
        )

    def heard(self, time: float) -> Mask:
        """Return which agents have reported lately, at a time, s: (N,)."""
        heard: Mask = time - self._reported <= MAX_REPORT_AGE
        return heard

    def down(self, time: float) -> Mask:
        """Return which agents are known to be on the ground at a time, s: (N,)."""
        low = (self._state & FINISHED != 0) & (self._height < LANDED_HEIGHT) & self._lands
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
        over: Mask = stopped & (~self._lands | (time >= self._land_until))
        return over

    def _landed(self, time: float) -> Mask:
        """Return which agents have ended a landing that was seen to begin: (N,)."""
        landed: Mask = self._landing_seen & (time >= self._land_until + LANDING_DELAY)
        return landed


@compiled
def note(  # noqa: PLR0913, PLR0917 -- the state of `GroundEvidence`, in one pass
    time: float,
    age: Array,
    state: Rows,
    position: Array,
    reported: Array,
    last_state: Rows,
    height: Array,
    top: Array,
    flew: Mask,
    steered_seen: Mask,
    steered_since: Array,
    lands: Mask,
    landing_seen: Mask,
) -> None:
    """Add the reports of a tick to the state of `GroundEvidence`, which is changed.

    Args:
        time: Of the tick, s.
        age: (N,) of the reports, s.
        state: (N,) bits of `Supervisor`.
        position: (N, 3) m.
        reported: (N,) s.
        last_state: (N,) bits of `Supervisor`.
        height: (N,) m.
        top: (N,) m.
        flew: (N,).
        steered_seen: (N,).
        steered_since: (N,) s.
        lands: (N,).
        landing_seen: (N,).
    """
    for row in range(len(age)):
        at = time - age[row]
        new = at > reported[row] + JITTER
        if new:
            reported[row], last_state[row], height[row] = at, state[row], position[row, 2]
        if height[row] > top[row] or math.isnan(top[row]):
            top[row] = height[row]
        if not new or last_state[row] & FLYING == 0:
            continue
        flew[row] = True
        if last_state[row] & ACTIVE == 0:
            if at > steered_since[row] + JITTER:
                steered_seen[row] = True
        elif last_state[row] & FINISHED == 0 and height[row] < top[row] - MIN_DESCENT:
            landing_seen[row] = landing_seen[row] or lands[row]
