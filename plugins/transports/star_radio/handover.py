"""Handover from setpoints to a high-level command: repeats both packets until it takes effect.

Setpoints have priority over the firmware's high-level commander until the drone is notified that
they stop. So a command takes two packets, and its answer confirms only one of them: a command whose
notification was lost is accepted but not flown, and 2 s after the last setpoint the firmware's
watchdog stops the motors. A setpoint that arrives late cancels the command and takes the priority
back. Neither is reported.
"""

from __future__ import annotations

import struct
from enum import Enum
from typing import Final, NamedTuple

from star_core import Supervisor
from star_radio import orders

REPEAT_PERIOD: Final = 0.1  # s, between two repetitions
MIN_REPEAT_TIME: Final = 0.5  # s after the confirmation: packets sent before it have arrived
WATCHDOG: Final = 2.0  # s without a setpoint, after which the firmware stops the motors
MAX_REPORT_AGE: Final = 0.3  # s, of a report used to detect a descent
MIN_DESCENT: Final = 0.1  # m, descent after which a landing counts as flown
LANDED_BELOW: Final = 0.1  # m

_DOWN: Final = int(Supervisor.TUMBLED | Supervisor.LOCKED | Supervisor.CRASHED)


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


class Handover:
    """Decides which packets of a command to repeat, and when.

    A stop and a landing are repeated as a whole, `REPEAT_PERIOD` apart, until `MIN_REPEAT_TIME`
    after the confirmation: a drone that already executes them ignores the repetitions. A landing is
    also repeated until the reports show a descent, but not beyond the watchdog's timeout. Other
    commands would restart: only their notification is repeated, except when the reports show that a
    late setpoint has cancelled the command.

    The notification follows the answer to the command, since without a plan to fly it would stop
    the motors.

    Args:
        packet: The command.
        what: Its name, for messages.
        at: Time of the first transmission, s.
        steered: Whether setpoints flew the drone before.

    Attributes:
        confirmed: Time of the confirmation, s; None before that.
        over: Whether nothing needs to be repeated any more.
        lands, stops: Whether the command is to land, or to stop the motors.
    """

    def __init__(self, packet: bytes, what: str, at: float, *, steered: bool) -> None:
        self.packet, self.what = packet, what
        self._steered = steered
        self.confirmed: float | None = None
        self.over = False
        self.lands, self.stops = packet[1] == orders.LAND, packet[1] == orders.STOP
        self._began = at
        self._due = at
        self._sent = False
        self._top = -float("inf")  # m, greatest height since the command
        self._descends = not self.lands
        (self._duration,) = struct.unpack("<f", packet[-4:]) if not self._descends else (0.0,)

    def repeat(self, now: float, report: Report | None) -> Repeat:
        """Return the packet to send at `now`, s, given the newest report."""
        if now < self._due:
            return Repeat.NOTHING
        self._due = now + REPEAT_PERIOD
        if not self._sent:
            self._sent, self._began = True, now
            return Repeat.ORDER
        if report is not None and not self._began < report.heard >= now - MAX_REPORT_AGE:
            report = None
        if report is not None:
            self._look(report)
        self._end(now, report)
        return Repeat.NOTHING if self.over else self._what(now, report)

    def _look(self, report: Report) -> None:
        self._top = max(self._top, report.height)
        self._descends |= report.height < self._top - MIN_DESCENT

    def _end(self, now: float, report: Report | None) -> None:
        """Determine whether the handover is over."""
        if self.confirmed is not None:
            passed = now - self.confirmed
            self.over = passed >= (MIN_REPEAT_TIME if self._descends else WATCHDOG)
        if self.lands and report is not None:
            flies = report.state & int(Supervisor.FLYING) and not report.state & _DOWN
            self.over |= not flies or report.height < LANDED_BELOW

    def _what(self, now: float, report: Report | None) -> Repeat:
        if self.stops:
            return Repeat.ORDER
        if self.lands:  # without reports: a landing may be over, another would restart the motors
            blind = report is None and now - self._began > max(MIN_REPEAT_TIME, self._duration / 2)
            return Repeat.NOTHING if blind else Repeat.ORDER
        if report is None or self.confirmed is None:
            return Repeat.NOTHING
        cancelled = self._steered and not report.state & int(Supervisor.COMMANDER_ACTIVE)
        return Repeat.ORDER if cancelled else Repeat.NOTIFICATION
