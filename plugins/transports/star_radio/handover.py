"""Handover from setpoints to a high-level command: repeats both packets until it takes effect.

Setpoints have priority over the firmware's high-level commander until the drone is notified that
they stop. So a command takes two packets, and its answer confirms only one of them: a command whose
notification was lost is accepted but not flown, and 2 s after the last setpoint the firmware's
watchdog stops the motors. A setpoint that arrives late cancels the command and takes the priority
back. Neither is reported.

So a landing over a bad link is begun anew, in time before that watchdog acts: a setpoint of zero
velocity feeds it, and cancels what may have arrived of the landing.
"""

from __future__ import annotations

import math
import struct
from enum import Enum
from typing import Final, NamedTuple

from star_core import Supervisor
from star_radio import orders

REPEAT_PERIOD: Final = 0.1  # s, between two repetitions
MIN_REPEAT_TIME: Final = 0.5  # s after the confirmation: packets sent before it have arrived
WATCHDOG: Final = 2.0  # s without a setpoint, after which the firmware stops the motors
FEED_AFTER: Final = 1.4  # s without a setpoint, after which one feeds the watchdog
FEEDS: Final = 3  # setpoints, one of which arrives
FEED_PERIOD: Final = 0.04  # s between them, at least
MAX_FEEDINGS: Final = 3  # in all; then a landing is repeated without
MAX_SETPOINT_DELAY: Final = 0.15  # s; a setpoint that arrives after a command would cancel it
MIN_NOTIFICATIONS: Final = 3  # one of which arrives
MAX_REPORT_AGE: Final = 0.3  # s, of a report used to detect a descent
MIN_DESCENT: Final = 0.1  # m, descent after which a landing counts as flown
LANDED_BELOW: Final = 0.1  # m

_DOWN: Final = int(
    Supervisor.TUMBLED | Supervisor.LOCKED | Supervisor.CRASHED | Supervisor.DECK_FAULT
)


class Report(NamedTuple):
    """The newest report of a drone.

    Attributes:
        heard: Arrival, s of the computer's clock.
        height: In the odometry frame, m; NaN if not reported.
        state: Bits of `Supervisor`.
    """

    heard: float
    height: float
    state: int


class Repeat(Enum):
    """Packet to send now."""

    NOTHING = 0
    NOTIFICATION = 1
    ORDER = 2  # the notification follows its answer
    SETPOINT = 3  # of zero velocity


class Handover:
    """Decides which packets of a command to repeat, and when.

    A stop and a landing are repeated as a whole, `REPEAT_PERIOD` apart, until `MIN_REPEAT_TIME`
    after the confirmation: a drone that already executes them ignores the repetitions. A landing is
    also repeated until the reports show a descent, but not beyond the watchdog's timeout. Other
    commands would restart: only their notification is repeated, except when the reports show that a
    late setpoint has cancelled the command.

    The notification follows the answer to the command, since without a plan to fly it would stop
    the motors.

    When `FEED_AFTER` has passed since the last setpoint and too few notifications were sent, a
    landing begins anew after setpoints of zero velocity. A drone that is not heard is not sent any:
    it may have landed or rebooted, and they would start its motors on the floor.

    Args:
        packet: The command.
        what: Its name, for messages.
        at: Time of the first transmission, s; later if a setpoint may arrive after it.
        setpoint_at: When the last setpoint was sent, s.
        steered: Whether setpoints flew the drone before.

    Attributes:
        confirmed: Time of the confirmation, s; None before that.
        over: Whether nothing needs to be repeated any more.
        lands, stops: Whether the command is to land, or to stop the motors.
        steered: As given, until the command has certainly taken over.
    """

    def __init__(
        self,
        packet: bytes,
        what: str,
        at: float,
        *,
        steered: bool,
        setpoint_at: float,
    ) -> None:
        self.packet, self.what = packet, what
        self.steered = self._was_steered = steered
        self.confirmed: float | None = None
        self.over = False
        self.lands, self.stops = packet[1] == orders.LAND, packet[1] == orders.STOP
        self._began = at
        self._due = at if self.stops else max(at, setpoint_at + MAX_SETPOINT_DELAY)
        self._sent = False
        self._setpoint_at = setpoint_at
        self._first: float | None = None  # s, when it was sent first
        self._feeds = self._feedings = 0  # setpoints that are still to be sent, and how often
        self._notifications = 0
        self._notified_at = -math.inf  # s
        self._top = -math.inf  # m, greatest height since the command
        self._descends = not self.lands
        (self._duration,) = struct.unpack("<f", packet[-4:]) if self.lands else (0.0,)

    def repeat(self, now: float, report: Report | None) -> Repeat:
        """Return the packet to send at `now`, s, given the newest report."""
        if self._must_feed(now, report):
            self._feed(now)
            return Repeat.SETPOINT
        if now < self._due:
            return Repeat.NOTHING
        self._due = now + REPEAT_PERIOD
        if not self._sent:
            self._sent, self._began = True, now
            self._first = now if self._first is None else self._first
            return Repeat.ORDER
        if report is not None and not self._began < report.heard >= now - MAX_REPORT_AGE:
            report = None
        if report is not None:
            self._look(report)
        self._end(now, report)
        return Repeat.NOTHING if self.over else self._what(now, report)

    def notified(self, now: float) -> None:
        """Note that the notification was sent at `now`, s, after an answer to the command."""
        self._notifications += 1
        self._notified_at = now
        self.steered &= self._notifications < MIN_NOTIFICATIONS

    def _must_feed(self, now: float, report: Report | None) -> bool:
        """Whether to send a setpoint of zero velocity at `now`, s."""
        if not (self.lands and self.steered) or self.over or self._first is None or report is None:
            return False
        if now - report.heard > MAX_REPORT_AGE or _is_down(report):
            return False
        if now < self._notified_at + MAX_SETPOINT_DELAY:
            return False  # a notification that arrives after a setpoint would stop the motors
        if self._feeds:
            return now >= self._setpoint_at + FEED_PERIOD
        return now >= self._setpoint_at + FEED_AFTER and self._feedings < MAX_FEEDINGS

    def _feed(self, now: float) -> None:
        """Begin anew after a setpoint at `now`, s."""
        if not self._feeds:
            self._feeds, self._feedings = FEEDS, self._feedings + 1
        self._feeds -= 1
        self._setpoint_at, self._due = now, now + MAX_SETPOINT_DELAY
        self._sent, self.confirmed, self._notifications = False, None, 0

    def _look(self, report: Report) -> None:
        self._top = max(self._top, report.height)
        self._descends |= report.height < self._top - MIN_DESCENT

    def _end(self, now: float, report: Report | None) -> None:
        """Determine whether the handover is over."""
        if self.confirmed is not None:
            passed = now - self.confirmed
            self.over = passed >= (MIN_REPEAT_TIME if self._descends else WATCHDOG)
        if self.lands and report is not None:
            self.over |= _is_down(report)

    def _what(self, now: float, report: Report | None) -> Repeat:
        if self.stops:
            return Repeat.ORDER
        if self.lands:  # without reports: a landing may be over, another would restart the motors
            until = self._began + max(MIN_REPEAT_TIME, self._duration / 2)
            if self.steered:
                until = max(until, self._setpoint_at + min(WATCHDOG, 0.8 * self._duration))
            return Repeat.NOTHING if report is None and now > until else Repeat.ORDER
        if report is None or self.confirmed is None:
            return Repeat.NOTHING
        cancelled = self._was_steered and not report.state & int(Supervisor.COMMANDER_ACTIVE)
        return Repeat.ORDER if cancelled else Repeat.NOTIFICATION


def _is_down(report: Report) -> bool:
    """Whether a drone is on the ground, or on its way there without motors."""
    flies = report.state & int(Supervisor.FLYING) and not report.state & _DOWN
    return not flies or report.height < LANDED_BELOW
