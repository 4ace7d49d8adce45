"""One Crazyflie: connection, commands, reports and disconnection."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple

from star_core import PluginError, Trajectory
from star_radio import orders, profiles
from star_radio.connection import log_blocks, packets
from star_radio.connection.estimator import ConvergenceWait, EstimatorNoise, reset_estimator
from star_radio.connection.link import Link
from star_radio.connection.log_values import LogValues
from star_radio.connection.questions import ATTEMPTS, Question
from star_radio.connection.tables import Table, Tables, read_now, set_now, setting
from star_radio.extra_reports import ACCELEROMETER, POSITION_VARIANCE, ExtraReports
from star_radio.handover import Handover, Repeat
from star_radio.options import RadioOptions
from star_radio.report import Layout, flying
from star_radio.report_stream import ReportStream
from star_radio.trajectories import upload

MIN_PROTOCOL_VERSION: Final = 4  # supports tables of more than 255 entries
REPORT_TIMEOUT: Final = 0.5  # s without a report while connecting, then the log block is recreated
END_OF_REPORTS_TIMEOUT: Final = 0.3  # s, for the confirmation that reports ended
MAX_REPORT_AGE: Final = 0.5  # s; the state of a drone that is not heard for longer is not known
LINK_LOST_TIMEOUT: Final = 1.0  # s without a report, after which a drone may be unreachable
LAST_ORDER_TIMEOUT: Final = 2.0  # s, for which closing waits for a landing or stop to be confirmed
LOST_ORDER_TIMEOUT: Final = 0.5  # s, the same for a drone that may be unreachable
CLOSING_POLL_PERIOD: Final = 0.02  # s, between checks whether the last commands are confirmed
LAND_DEPTH: Final = 0.15  # m below the floor, at which a landing ends: see `landing`
MIN_LAND_TIME: Final = 3.0  # s, of the landing on closing
LAND_TIME_PER_HEIGHT: Final = 3.0  # s/m
_ALREADY: Final = 1  # error if the drone already executes the command: another plan is active
_BUSY: Final = 16  # errno of a command that the supervisor blocks for now
_ERRORS: Final = {8: "it does not know it", 16: "its supervisor blocks it", 22: "it is invalid"}


class CommandFailure(NamedTuple):
    """A packet that a drone refused or did not confirm: message, and whether it was refused."""

    text: str
    refused: bool


class Vehicle:
    """A Crazyflie over its link.

    Attributes:
        version: Protocol version of its firmware.
        stream: Its reports.
        position_variance: Those of the variances of its position, where it knows the map.
        variables: Its table of log variables.
        take_off_memory: Number of the memory for profiles of take-offs; None if there is none.
        settling: Whether `connect` waits for its estimator to settle.
        steered: Whether it is flown by setpoints.
        steered_at: When the last setpoint was sent, s of the computer's clock.
        stopped: Whether the last command was to stop the motors.
        rebooted: Whether it rebooted since it was connected, by the clock of its reports. It is
            not flown any more: it is on the floor, and its estimator has been reset. If it reports
            to fly nevertheless, it is landed.
    """

    def __init__(self, name: str, link: Link) -> None:
        self.name = name
        self.link = link
        self.version = 0
        self.variables: Table = {}
        self.parameters: Table = {}
        self.take_off_memory: int | None = None
        self.settling = False
        self.steered = False
        self.rebooted = False
        self.stopped = False
        self._groups = orders.ALL_GROUPS  # groups it was assigned to, a bit each
        self._handover: Handover | None = None  # of the last command
        self._order: Question | None = None  # the last command, until it is confirmed
        self._once = False  # whether it is not repeated by the link
        self.steered_at = -math.inf  # s, when the last setpoint was sent
        self._end_of_reports: Question | None = None
        self._close_by = 0.0  # s, deadline of closing
        self._noise = EstimatorNoise()
        self._convergence = ConvergenceWait()
        self._values = LogValues()
        self._deadline = self._response_timeout = 0.0
        self.accelerometer = ExtraReports(link, ACCELEROMETER)
        self.position_variance = ExtraReports(link, POSITION_VARIANCE)
        self.stream = ReportStream(link, self._hear)

    def connect(
        self,
        options: RadioOptions,
        tables: Tables,
        period: float,
        groups: int | None = orders.MISSION,
        *,
        in_map: bool = False,
    ) -> None:
        """Open the link, start reports every `period`, s, and assign the drone to groups.

        Commands are addressed to these groups, a bit each: a drone that reboots leaves them and
        ignores commands. With None it may be in flight: its groups and what flies it are left
        alone. With `in_map` the drone also reports the variances of its position.
        """
        self._deadline = time.monotonic() + options.connect_timeout
        self._response_timeout = options.response_timeout
        self.link.open(options.response_timeout)
        question = packets.packet(packets.PLATFORM, packets.VERSION, packets.PROTOCOL)
        (answer,) = self._ask([Question.of(question, packets.PROTOCOL, "its protocol version")])
        self.version = answer[1]
        if self.version < MIN_PROTOCOL_VERSION:
            raise PluginError(
                f"{self.link.uri} has protocol version {self.version}, expected "
                f"{MIN_PROTOCOL_VERSION} or later: update its firmware",
                "outdated-firmware",
            )
        self.variables = variables = tables.of(packets.LOG, self._ask)
        layout = Layout.of(variables)
        self.parameters = tables.of(packets.PARAMETER, self._ask)
        own = options.agent_parameters.get(self.name, {})
        for name, value in {**options.parameters, **own}.items():
            set_now(self.parameters, name, value, self._ask)
        if options.reset:
            reset_estimator(self.parameters, self._ask)
        if groups is not None:  # otherwise it may be in flight, and its motors would stop
            self.link.post(orders.no_more_setpoints())  # an earlier client may have sent some
        reports = layout, variables, period, self._ask, self._response_timeout
        packet = packets.packet(packets.LOG, packets.SETTINGS, packets.RESET)
        self._ask([Question.of(packet, packets.RESET, "the end of earlier reports")])
        self.stream.begin(*reports)
        if options.reset:
            self.settle()
        if time.monotonic() - self.stream.heard > REPORT_TIMEOUT:  # ended by a late copy
            self.stream.begin(*reports)
        if groups is None:
            return
        self._begin_extra_reports(in_map=in_map)
        if options.descent:
            self.take_off_memory = profiles.reserve(self._ask)
        packet = orders.set_groups(groups)  # last: a drone in a group has been connected
        (answer,) = self._ask([Question.of(packet, packet[1:], "its groups")])
        if error := _error(answer):
            why = _ERRORS.get(error, f"error {error}")
            text = f"{self.link.uri} refuses to be put into groups: {why}"
            raise PluginError(text, "refused-request")
        self._groups = groups

    def _begin_extra_reports(self, *, in_map: bool) -> None:
        extra = [self.accelerometer, *([self.position_variance] if in_map else ())]
        for reports in extra:
            reports.begin(self.name, self.variables, self._ask, self._response_timeout)

    def settle(self) -> None:
        """Wait until its estimator has converged; this blocks.

        Raises:
            PluginError: It has not in some seconds.
        """
        self.settling = True
        try:
            self._convergence.wait(self.variables, self._ask)
        finally:
            self.settling = False

    def read_parameters(self, names: Iterable[str]) -> dict[str, float]:
        """Return values of parameters by name, without those that it lacks; this blocks."""
        return read_now(self.parameters, names, self._ask)

    def read_log(self, names: Sequence[str]) -> dict[str, float]:
        """Return values of log variables by name, without those that it lacks; this blocks."""
        return self._values.read(self.variables, names, self._ask, self._response_timeout)

    def firmware(self) -> str:
        """Return the name of its firmware's version; empty if it does not answer. This blocks."""
        question = packets.packet(packets.PLATFORM, packets.VERSION, packets.FIRMWARE)
        try:
            (answer,) = self._ask([Question.of(question, packets.FIRMWARE, "its firmware")])
        except PluginError:  # older than the question
            return ""
        return answer[1:].partition(b"\0")[0].decode("utf-8", "replace")

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter and wait for the confirmation; this blocks, without a deadline."""
        self._deadline = math.inf
        set_now(self.parameters, name, value, self._ask)

    def begin_setting(self, name: str, value: float) -> None:
        """Set a parameter until that is confirmed; a newer value replaces it.

        Raises:
            PluginError: The firmware lacks it, or it cannot have the value.
        """
        question = setting(self.parameters, name, value)
        question.topic = f"parameter {name}"
        self.link.assure(question)

    def _hear(self, payload: bytes) -> None:
        """Take a report that is not of the state; runs in the receiving thread."""
        self._convergence.hear(payload)
        self._values.hear(payload)
        self.accelerometer.hear(payload)
        self.position_variance.hear(payload)

    def steer(self, setpoint: bytes) -> None:
        """Send a setpoint made by `orders.velocity` or `orders.full_state`."""
        if not self.steered:
            self.steered = True
            self.stopped = False
            self.confirm()  # a repeated command would take control back from the setpoint
            self._handover = None
        self.steered_at = time.monotonic()
        self.link.steer(setpoint)

    def order(self, packet: bytes, what: str, *, sent: bool = False, once: bool = False) -> None:
        """Send a high-level command and make sure that it takes over from setpoints.

        It is repeated until it is confirmed, and longer: see `Handover`. Unless it stops the
        motors, it is delayed until the last setpoint has arrived. A newer command replaces it. It
        is for all groups, unless it has just been broadcast (`sent`). The link does not repeat one
        that is to be sent `once`.
        """
        now = time.monotonic()
        self.stopped = packet[1] == orders.STOP
        if not (sent or self.stopped):
            packet = orders.only_for(self._groups, packet)
        steered = self.steered or (self._handover is not None and self._handover.steered)
        last = self.steered_at
        self._handover = Handover(packet, what, now, steered=steered, setpoint_at=last)
        self.steered = False
        self.link.forget("order")
        self._order, self._once = None, once
        self._hand_over(now, sent=sent)

    def arm(self) -> None:
        """Arm the drone."""
        packet = orders.arm(self.version)
        if self.version >= orders.SUPERVISOR_FROM:
            self.link.assure(Question.of(packet, b"\x81", "the order to arm", topic="arm"))
        else:
            self.link.post(packet)  # older firmware does not answer

    def lock(self) -> None:
        """Stop the motors and lock the drone until a power cycle; this is not confirmed."""
        for _time in range(3):
            self.link.post(orders.emergency_stop(self.version))

    def set_noise(self, position_std: float, attitude_std: float) -> None:
        """Set the standard deviations of the corrections that follow, m and rad.

        An infinite value means that no such correction follows.
        """
        try:
            for question in self._noise.changed(self.parameters, position_std, attitude_std):
                self.link.assure(question)
        except PluginError as error:
            raise PluginError(f"{self.name}: {error.message}", error.code) from error

    def correct(self, position: Sequence[float], attitude: Sequence[float] | None) -> None:
        """Send the estimator a measured position, m, or pose with a unit quaternion x, y, z, w."""
        at = (
            orders.measured_position(position)
            if attitude is None
            else orders.measured_pose(position, attitude)
        )
        self.link.post(at)

    def upload(self, number: int, trajectory: Trajectory, *, at: int = 0) -> None:
        """Upload a trajectory to byte `at` of the memory; this blocks: not for use in a tick."""
        self._deadline = math.inf
        upload(number, trajectory, self._ask, at=at)

    def confirm(self) -> None:
        """Treat the last command as confirmed, so that it is not repeated."""
        self.link.forget("order")
        self._order = None
        if self._handover is not None:
            self._handover.confirmed = time.monotonic()

    def retry(self, now: float) -> list[CommandFailure]:
        """Repeat unconfirmed packets; return those that were refused or never confirmed."""
        failures = []
        for question in self.link.retry(now):
            if question.topic.startswith((log_blocks.TOPIC, profiles.TOPIC)):
                continue  # `ReportStream` repeats it, and `Takeoffs` does without
            answer = question.answer if question.answer is not None else question.refused
            error = _error(answer) if answer and question.topic == "order" else 0
            if question is self._order and self._ends_order(now, answer, error):
                continue
            if self._noise.given_up(question):
                continue  # already logged
            if error:
                why = _ERRORS.get(error, f"error {error}")
                failures.append(CommandFailure(f"refuses {question.about}: {why}", refused=True))
            elif question.answer is None:
                failures.append(CommandFailure(f"does not confirm {question.about}", refused=False))
        self.stream.restore(now)
        self.accelerometer.restore(now)
        self.position_variance.restore(now)
        self._check_for_reboot()
        self._hand_over(now)
        return failures

    @property
    def airborne(self) -> bool:
        """Whether it flies, by its newest report, or is flown by setpoints.

        A drone whose motors were stopped is not: although it reports to be flying for another 2 s,
        a landing would restart them.
        """
        _heard, height, state = self.stream.newest
        return not self.stopped and (self.steered or bool(flying(state, height)))

    @property
    def repeats(self) -> bool:
        """Whether the last command may still be sent again by the link."""
        return self._order is not None

    @property
    def lands(self) -> bool:
        """Whether the last command was to land."""
        return self._handover is not None and self._handover.lands

    def land(self) -> None:
        """Command it to land from its position."""
        self.order(landing(self.stream.newest.height), "land")

    def begin_closing(self) -> None:
        """Land the drone if it flies.

        If it is flown by setpoints, the firmware's timeout would otherwise stop its motors in the
        air and lock it; if by its high-level commander, it would stay airborne.
        """
        if self.stream.layout is None:
            return
        now = time.monotonic()
        lost = now - self.stream.heard > LINK_LOST_TIMEOUT
        self._close_by = now + (LOST_ORDER_TIMEOUT if lost else LAST_ORDER_TIMEOUT)
        if self.airborne and not self.lands:
            self.land()

    def end_reports(self) -> None:
        """Stop the reports and leave the high-level commander usable for the next client."""
        if self.stream.layout is None:
            return
        now = time.monotonic()
        self._close_by = now + END_OF_REPORTS_TIMEOUT
        planned = self._handover is not None and self._handover.confirmed is not None
        # Without a plan the notification stops the motors of a drone that flies.
        if now - self.stream.heard <= MAX_REPORT_AGE and (planned or not self.airborne):
            self.link.post(orders.no_more_setpoints())
        self._handover = None
        packet = packets.packet(packets.LOG, packets.SETTINGS, packets.RESET)
        about = "the end of reports"
        self.link.forget(log_blocks.TOPIC)
        self._end_of_reports = Question.of(packet, packets.RESET, about, topic=log_blocks.TOPIC)
        self.link.assure(self._end_of_reports)

    def is_closing(self, now: float) -> bool:
        """Whether `begin_closing` or `end_reports` still waits for a confirmation at `now`, s."""
        handover, ending = self._handover, self._end_of_reports
        ordered = handover is not None and (handover.lands or handover.stops) and not handover.over
        leaves = ending is not None and ending.answer is None
        return now < self._close_by and (ordered or leaves)

    def _ask_order(self, handover: Handover, *, sent: bool = False) -> None:
        """Send a command until it is confirmed, and let it take over from setpoints."""
        packet = handover.packet
        self._order = Question(
            packet,
            packets.address(packet[0]),
            packet[1:4],  # echoed, followed by an error number
            f"the order to {handover.what}",
            topic="order",
            on_answer=self._notify,
            accepts=lambda payload: _error(payload) != _BUSY,
            retries=1 if self._once else ATTEMPTS,
            sendings=int(sent),  # a broadcast is repeated, and answered each time
        )
        self.link.assure(self._order, sent=sent)
        if handover.stops:
            self.link.post(orders.no_more_setpoints())

    def _notify(self, answer: bytes) -> None:
        """Let an accepted command take over from setpoints."""
        if _error(answer) in {0, _ALREADY}:
            self.link.post(orders.no_more_setpoints())
            if self._handover is not None:
                self._handover.notified(time.monotonic())

    def _ends_order(self, now: float, answer: bytes | None, error: int) -> bool:
        """Record the outcome of the last command; return whether it was accepted."""
        order, handover = self._order, self._handover
        self._order = None
        if order is None or handover is None or handover.confirmed is not None:
            return True
        if self._once and (answer is None or error == _BUSY):
            return True  # it may be sent anew
        if answer is None:  # no more retries here; `_hand_over` may send it again
            return False
        # an earlier copy of the command is already being executed
        already = error == _ALREADY and (order.unheard or handover.lands)
        if error and not already:
            self._handover = None
            return False
        handover.confirmed = now
        return True

    def _check_for_reboot(self) -> None:
        """Detect a reboot by the clock; pending commands are then dropped."""
        if self.stream.clock.restarted and not self.rebooted:
            self.rebooted, self.steered = True, False
            self._groups = orders.ALL_GROUPS  # it has left the others
            self.link.forget("order")
            self._handover = self._order = None
        if self.rebooted and (self._handover is None or self._handover.over) and self.airborne:
            self.land()

    def _hand_over(self, now: float, *, sent: bool = False) -> None:
        """Send the packets that the handover to the last command needs now."""
        handover = self._handover
        if handover is None or handover.over:
            return
        restarts = not (handover.lands or handover.stops)
        if restarts and self._order is not None and handover.confirmed is None:
            return  # the link repeats it
        match handover.repeat(now, self.stream.newest):
            case Repeat.ORDER:
                self._ask_order(handover, sent=sent)
            case Repeat.NOTIFICATION:
                self.link.post(orders.no_more_setpoints())
            case Repeat.SETPOINT:
                self.link.forget("order")
                self._order, self.steered_at = None, now
                self.link.steer(orders.velocity((0.0, 0.0, 0.0), 0.0, self.version))

    def _ask(self, questions: Sequence[Question]) -> list[bytes]:
        """Ask questions, blocking; for connecting and uploading."""
        return self.link.ask_all(questions, timeout=self._response_timeout, deadline=self._deadline)


def close_all(vehicles: Iterable[Vehicle], begin: Callable[[Vehicle], None]) -> None:
    """Begin to close drones, by `begin_closing` or `end_reports`, and wait for confirmations."""
    vehicles = list(vehicles)
    for vehicle in vehicles:
        begin(vehicle)
    while any(vehicle.is_closing(time.monotonic()) for vehicle in vehicles):
        time.sleep(CLOSING_POLL_PERIOD)
        for vehicle in vehicles:
            vehicle.retry(time.monotonic())


def landing(height: float) -> bytes:
    """Return the command to land from a height, m.

    The motors stop at the end of the plan. The drone follows it late, or too high, and would fall
    if that were on the floor. So it crosses the floor at 0.3 m/s or less and ends below.
    """
    return orders.land(-LAND_DEPTH, landing_time(height))


def landing_time(height: float) -> float:
    """Return how long a landing from a height, m, takes, s."""
    return MIN_LAND_TIME + LAND_TIME_PER_HEIGHT * max(0.0, height)  # `max` drops a NaN here


def _error(payload: bytes) -> int:
    """Return the error number in the confirmation of a command; 0 means success."""
    return payload[3] if len(payload) > 3 else 0  # noqa: PLR2004
