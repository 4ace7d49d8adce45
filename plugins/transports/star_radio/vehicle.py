"""One Crazyflie: how it is connected, told what to do, and let go."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from typing import Final, NamedTuple

from star_core import PluginError, Supervisor
from star_radio import orders, packets
from star_radio.answers import Question
from star_radio.clock import Clock
from star_radio.deviations import Deviations
from star_radio.estimator import Settling, start_anew
from star_radio.link import Link
from star_radio.manner import Manner
from star_radio.parameters import set_now
from star_radio.report import BLOCK, STATE, Layout, Z, stamp
from star_radio.tables import Table
from star_radio.trajectory import Piece, upload

OLDEST: Final = 4  # protocol version with tables of more than 255 entries
LOOK: Final = 0.005  # s between two looks for the first report
GOODBYE: Final = 0.3  # s, for which a drone may confirm that it reports no more
LOW: Final = 0.1  # m: who is no higher and has finished its plan stands
DESCENT: Final = 3.0  # s, of a landing that nobody waits for
KEPT: Final = 1000  # reports that are kept for a reader that is late: 10 s of them
_ALREADY: Final = 1  # what an order to do what is being done is answered: a plan is in the way
_BUSY: Final = 16  # errno of an order that the supervisor blocks for now
_WORDS: Final = {8: "it does not know it", 16: "its supervisor blocks it", 22: "it is wrong"}


class Trouble(NamedTuple):
    """What is wrong with something that a drone was told.

    Attributes:
        words: They follow its name.
        refused: It is an order, and the drone says no.
    """

    words: str
    refused: bool


class Vehicle:
    """A Crazyflie over its link.

    Args:
        name: Of the agent.
        link: To it; not open yet.

    Attributes:
        version: Of the protocol that its firmware speaks.
        layout: Of its reports; None before it is connected.
        parameters: Its table of parameters.
        clock: Of its reports.
        heard: When its last report arrived, s of the computer's clock; before the first, when it
            was made.
        steered: Whether setpoints fly it.
    """

    def __init__(self, name: str, link: Link) -> None:
        self.name = name
        self.link = link
        self.version = 0
        self.layout: Layout | None = None
        self.parameters: Table = {}
        self.clock = Clock()
        self.heard = time.monotonic()
        self.steered = False
        self._deviations = Deviations()
        self._settling = Settling()
        self._until = self._patience = 0.0
        self._samples: deque[tuple[float, bytes]] = deque(maxlen=KEPT)
        self._newest = b""  # report

    def connect(self, manner: Manner, groups: int | None = None) -> None:
        """Open the link, have it report, and put it into groups, a bit each, unless that is None.

        Raises:
            PluginError: It cannot be reached, is too old, or refuses; says why.
        """
        self._until = time.monotonic() + manner.deadline
        self._patience = manner.patience
        self.link.open(manner.patience)
        question = packets.packet(packets.PLATFORM, packets.VERSION, packets.PROTOCOL)
        self.version = self._ask(question, packets.PROTOCOL, "its protocol version")[1]
        if self.version < OLDEST:
            raise PluginError(
                f"{self.link.uri} speaks protocol version {self.version}, expected {OLDEST} or "
                "later: update its firmware"
            )
        variables = manner.tables.of(packets.LOG, self._ask)
        layout = Layout.of(variables)
        self.parameters = manner.tables.of(packets.PARAMETER, self._ask)
        for name, value in manner.parameters.items():
            set_now(self.parameters, name, value, self._ask)
        if manner.reset:
            start_anew(self.parameters, self._ask)
        self.link.post(orders.no_more_setpoints())  # a client before may have left some
        self.layout = layout
        self.link.report = partial(self._take, layout.size)
        for _attempt in range(2):
            layout.begin(variables, manner.period, self._ask)
            if self._reported(manner.patience):
                break
        else:
            raise PluginError(f"{self.link.uri} does not report its state")
        if manner.reset:
            self._settling.wait(variables, self._ask)
        if groups is not None:  # last: who is in a group has been connected
            packet = orders.set_groups(groups)
            if error := _error(self._ask(packet, packet[1:], "its groups")):
                why = _WORDS.get(error, f"error {error}")
                raise PluginError(f"{self.link.uri} refuses to be put into groups: {why}")

    def reports(self) -> list[tuple[float, bytes]]:
        """Return what was reported since the last call: when, by the computer's clock, and what."""
        samples = self._samples
        return [samples.popleft() for _ in range(len(samples))]

    def steer(self, setpoint: bytes) -> None:
        """Fly what `orders.velocity`, `orders.position` or `orders.full_state` packed."""
        if not self.steered:
            self.steered = True
            self.confirm()  # it takes over: an order that is given again would take back
        self.link.steer(setpoint)

    def let_go(self) -> None:
        """End setpoints: else an order would be heard and not flown."""
        self.steered = False
        self.link.post(orders.no_more_setpoints())

    def order(self, packet: bytes, what: str, *, sent: bool = False) -> None:
        """Give a high-level order, and again until it is confirmed; a newer one takes its place.

        Setpoints are to be ended first: see `let_go`.

        Args:
            packet: The order, for whichever groups.
            what: Its name, for messages.
            sent: Whether this very packet has just been broadcast.
        """
        self.link.assure(
            Question(
                packet,
                (orders.HIGH_LEVEL, 0),
                packet[1:4],  # comes back, and then an error number
                f"the order to {what}",
                topic="order",
                accepts=lambda payload: _error(payload) != _BUSY,
                sendings=int(sent),  # a broadcast is repeated, and each time answered
            ),
            sent=sent,
        )

    def arm(self) -> None:
        """Let the motors be started."""
        packet = orders.arm(self.version)
        if self.version >= orders.SUPERVISOR_FROM:
            place = (orders.SUPERVISOR, 1)
            self.link.assure(Question(packet, place, b"\x81", "the order to arm", topic="arm"))
        else:
            self.link.post(packet)  # older firmware does not answer

    def lock(self) -> None:
        """Stop the motors until the drone is switched off and on; nobody confirms it."""
        for _time in range(3):
            self.link.post(orders.emergency_stop(self.version))

    def weigh(self, position_deviation: float, attitude_deviation: float) -> None:
        """Tell the estimator how sure positions and attitudes are that follow, m and rad.

        What has an infinite deviation does not follow.

        Raises:
            PluginError: The firmware cannot be told that.
        """
        sure = self._deviations.changed(self.parameters, position_deviation, attitude_deviation)
        try:
            for question in sure:
                self.link.assure(question)
        except PluginError as error:
            raise PluginError(f"{self.name}: {error}") from error

    def correct(self, position: Sequence[float], attitude: Sequence[float] | None) -> None:
        """Tell the estimator where the drone is, in the odometry frame.

        Args:
            position: m.
            attitude: Unit quaternion x, y, z, w, if that is told too.
        """
        at = orders.seen_at(position) if attitude is None else orders.seen_as(position, attitude)
        self.link.post(at)

    def upload(self, number: int, pieces: Sequence[Piece], *, at: int = 0) -> None:
        """Upload a trajectory to byte `at` of the memory; not for use in a tick.

        Raises:
            ContractError: It does not fit.
            PluginError: The drone refuses, or does not answer.
        """
        self._until = math.inf
        upload(number, pieces, self._ask, at=at)

    def follow(self, number: int, *, stretch: float = 1.0, relative: bool = False) -> None:
        """Fly a trajectory that was uploaded, `stretch` times slower; `relative` is from here."""
        packet = orders.start_trajectory(number, self.version, stretch=stretch, relative=relative)
        self.let_go()
        self.order(packet, f"follow trajectory {number}")

    def confirm(self) -> None:
        """Take it that the last order was heard: it is not given again."""
        self.link.forget("order")

    def chase(self, now: float) -> list[Trouble]:
        """Ask again what is not confirmed; say what was refused, or never confirmed."""
        troubles = []
        for question in self.link.chase(now):
            answer = question.answer if question.answer is not None else question.refused
            error = _error(answer) if answer and question.topic == "order" else 0
            if error == _ALREADY and question.unheard:
                continue  # it does what it was told before
            if self._deviations.given_up(question):
                continue  # that was said
            if error:
                why = _WORDS.get(error, f"error {error}")
                troubles.append(Trouble(f"refuses {question.about}: {why}", refused=True))
            elif question.answer is None:
                troubles.append(Trouble(f"does not confirm {question.about}", refused=False))
        return troubles

    def close(self) -> None:
        """Let the drone go, and never lock it.

        The high-level commander may be used again by whoever connects next. A drone that flies is
        told to land: if setpoints fly it its own time-out would stop its motors in the air and lock
        it, and if its commander does, it would stay up there.
        """
        if self.layout is not None:
            self.link.post(orders.no_more_setpoints())
            if self.steered or self._flies(self.layout):
                land = orders.land(0.0, DESCENT)
                with suppress(PluginError):  # it may be gone
                    self.link.ask(land, land[1:4], "the order to land", patience=GOODBYE)
            reset = packets.packet(packets.LOG, packets.SETTINGS, packets.RESET)
            with suppress(PluginError):  # it may be gone
                self.link.ask(reset, packets.RESET, "the end of reports", patience=GOODBYE)
        self.link.close()

    def _flies(self, layout: Layout) -> bool:
        """Whether its newest report says so; one that has just landed does not."""
        if not self._newest:
            return False
        (values,) = layout.read([self._newest])
        bits = 0 if math.isnan(values[STATE]) else int(values[STATE])
        under_way = not bits & Supervisor.COMMANDER_FINISHED
        return bool(bits & Supervisor.FLYING) and (under_way or bool(values[Z] > LOW))

    def _take(self, size: int, payload: bytes, arrived: float) -> None:
        """Keep a report; here, where no tick waits for it, it is also told when it was made."""
        if len(payload) == size and payload[0] == BLOCK:
            self._samples.append((self.clock.time(stamp(payload), arrived), payload))
            self._newest, self.heard = payload, arrived
        else:
            self._settling.hear(payload)

    def _reported(self, patience: float) -> bool:
        """Wait for the first report; say whether it came."""
        until = min(self._until, time.monotonic() + patience)
        while not self._samples and time.monotonic() < until:
            time.sleep(LOOK)
        return bool(self._samples)

    def _ask(self, packet: bytes, start: bytes, about: str) -> bytes:
        patience = min(self._patience, self._until - time.monotonic())
        if patience <= 0:
            raise PluginError(f"{self.link.uri} is too slow: it is not connected in time")
        return self.link.ask(packet, start, about, patience=patience)


def _error(payload: bytes) -> int:
    """Return the error number of an order's confirmation; 0 is none."""
    return payload[3] if len(payload) > 3 else 0  # noqa: PLR2004
