"""One link to a Crazyflie, over whatever cflib has a driver for: packets out, what comes in.

cflib's drivers are used and nothing above them: no thread per request, nothing that blocks the
tick, no setpoint when a link is closed (which locks a drone that has just landed), and questions
are asked again on every kind of link (cflib does so over radios without safelink only).
"""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections import deque
from typing import Any, Final

import cflib.crtp
from cflib.crtp.crtpstack import CRTPPacket

from star_core import PluginError
from star_radio import packets
from star_radio.answers import AGAIN_AFTER, Answers, Question
from star_radio.outbox import Outbox
from star_radio.quiet import end

log = logging.getLogger(__name__)

POLL: Final = 0.1  # s, how long a reader waits before it looks whether it should end
BREATH: Final = 0.05  # s, by which a driver that fails is held up, else it fails without a pause
BEAT: Final = 0.5  # s without a packet, after which an echo tells the drone that we listen
ENDED: Final = 2.0  # s of silence, in spite of echoes, after which a TCP connection is given up
CLOSES: Final = 1.5  # s, after which a driver is left to close by itself
WAKE: Final = packets.packet(packets.LOG, packets.SETTINGS, packets.RESET)
KEPT: Final = 1000  # reports that are kept for a reader that is late: 10 s of them


class Link:
    """Packets to and from one Crazyflie.

    Args:
        uri: Its address, of any kind that cflib has.
        name: Of the agent, for messages.

    Attributes:
        uri: As given.
        broken: The driver's last complaint; empty without one. A link may well recover.
        quality: What the dongle says of the link, by cflib's names; empty on links without one.
        round_trip: How long the last echo took to the drone's firmware and back, s; NaN before.
    """

    def __init__(self, uri: str, name: str) -> None:
        self.uri = uri
        self.broken = ""
        self.quality: dict[str, float] = {}
        self.round_trip = math.nan
        self._name = name
        self._driver: Any = None
        self._answers = Answers()
        self._reports: deque[tuple[float, bytes]] = deque(maxlen=KEPT)
        self._outbox = Outbox(self._send, name)
        self._ends = uri.startswith("tcp://")  # cflib does not notice when
        self._prompt = uri.startswith("udp://")  # sending a datagram does not block
        self._sender = 0  # thread that sends now
        self._last = 0.0  # s of the computer's clock, when something was sent
        self._sending = threading.Lock()
        self._reader: threading.Thread | None = None
        self._closing = False

    def open(self, patience: float) -> None:
        """Start the driver.

        Args:
            patience: How long it may take, s; over TCP cflib would wait for minutes.

        Raises:
            PluginError: There is none for the address, no dongle, or nobody there.
        """
        if not cflib.crtp.CLASSES:
            cflib.crtp.init_drivers()
        found: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._start, args=(found,), daemon=True).start()
        try:
            driver = found.get(timeout=patience)
        except queue.Empty:
            self._closing = True
            raise PluginError(f"{self.uri}: not opened in {patience:g} s") from None
        if isinstance(driver, Exception):
            raise PluginError(f"{self.uri}: {driver}") from driver
        if driver is None:
            raise PluginError(f"cflib has no driver for {self.uri!r}")
        self._driver = driver
        self._reader = threading.Thread(
            target=self._read, name=f"star-radio-{self._name}", daemon=True
        )
        self._reader.start()
        if not self._prompt:
            self._outbox.start()

    def post(self, packet: bytes) -> None:
        """Send a packet after those before it, without waiting; a setpoint that waits is void."""
        if self._prompt:
            self._send(packet)
        else:
            self._outbox.order(packet)

    def steer(self, setpoint: bytes) -> None:
        """Send a setpoint without waiting; it takes the place of one that could not be sent yet."""
        if self._prompt:
            self._send(setpoint)
        else:
            self._outbox.steer(setpoint)

    def ask(
        self,
        packet: bytes,
        start: bytes,
        about: str,
        *,
        patience: float,
        channel: int | None = None,
    ) -> bytes:
        """Send a packet until it is answered, and return the answer's payload.

        Args:
            packet: What to ask.
            start: How the answer begins; it comes on the same port.
            about: What for, in words.
            patience: How long to wait in all, s.
            channel: That the answer comes on; None is the question's own.

        Raises:
            PluginError: There is no answer.
        """
        question = self._question(packet, start, about, channel)
        until = time.monotonic() + patience
        self._answers.add(question)
        try:
            while not self._closing:
                self.post(packet)
                if question.done.wait(min(AGAIN_AFTER, max(0.0, until - time.monotonic()))):
                    return question.answer or b""
                if time.monotonic() >= until:
                    break
        finally:
            self._answers.drop(question)
        why = f" ({self.broken})" if self.broken else ""
        raise PluginError(f"no answer about {about} from {self.uri} in {patience:g} s{why}")

    def assure(self, question: Question, *, sent: bool = False) -> None:
        """Send a question that has a topic, and again in `chase` until it is answered.

        Args:
            question: What to ask.
            sent: Whether it has just been sent in another way.
        """
        self._answers.add(question)
        if not sent:
            self.post(question.packet)

    def chase(self, now: float) -> list[Question]:
        """Ask again what is not answered at `now`, s of the computer's clock.

        Returns:
            What was answered since the last call, and what is given up: it has no answer.
        """
        for question in self._answers.overdue(now):
            self.post(question.packet)
        return self._answers.ended()

    def reports(self) -> list[tuple[float, bytes]]:
        """Return what was reported since the last call: when it arrived, and the payload."""
        arrived = []
        while self._reports:
            arrived.append(self._reports.popleft())
        return arrived

    def close(self) -> None:
        """Stop the driver. Safe to call twice."""
        self._closing = True
        self._outbox.stop()
        driver, self._driver = self._driver, None
        if driver is not None:
            ending = threading.Thread(target=self._end, args=(driver,), daemon=True)
            ending.start()
            until = time.monotonic() + CLOSES
            while ending.is_alive() and time.monotonic() < until:
                if self._prompt:  # an answer wakes the driver's thread, which else sleeps for 1 s
                    driver.send_packet(CRTPPacket(WAKE[0], WAKE[1:]))
                ending.join(POLL / 4)
        if self._reader is not None:
            self._reader.join(2 * POLL)

    def _end(self, driver: Any) -> None:
        try:
            end(driver)
        except Exception as error:  # noqa: BLE001 -- the others are to be closed all the same
            log.debug("%s: %s", self.uri, error)

    def _start(self, found: queue.Queue[Any]) -> None:
        """Open the driver, which may take long; close it if nobody waits any more."""
        try:
            driver = cflib.crtp.get_link_driver(self.uri, self._note_quality, self._complain)
        except Exception as error:  # noqa: BLE001 -- drivers raise what they like
            found.put(error)
            return
        found.put(driver)
        if self._closing and driver is not None:
            driver.close()

    def _question(self, packet: bytes, start: bytes, about: str, channel: int | None) -> Question:
        port, own = packets.address(packet[0])
        return Question(packet, (port, own if channel is None else channel), start, about)

    def _send(self, packet: bytes) -> None:
        driver = self._driver
        if driver is None:
            return
        wire = CRTPPacket(packet[0], packet[1:])
        with self._sending:
            self._last = time.monotonic()
            self._sender = threading.get_ident()
            try:
                driver.send_packet(wire)
            except Exception as error:  # noqa: BLE001 -- one link must not stop the others
                if self._driver is driver:  # else it has just been closed
                    self._complain(str(error))
            finally:
                self._sender = 0

    def _read(self) -> None:
        """Take packets in until the link is closed; runs in a thread of its own."""
        heard = time.monotonic()
        while not self._closing:
            driver = self._driver
            if driver is None:
                return
            packet = driver.receive_packet(POLL)
            arrived = time.monotonic()
            if arrived - self._last > BEAT:
                self.post(packets.echo(arrived))
            if packet is not None:
                heard = arrived
            elif self._ends and arrived - heard > ENDED:
                self._driver = None
                self._complain("the connection is gone")
                self._end(driver)
                return
            if packet is None or packets.is_null(packet.header):
                continue
            place = packets.address(packet.header)
            payload = bytes(packet.data)
            if place == (packets.LOG, packets.DATA):
                self._reports.append((arrived, payload))
            elif (sent := packets.echoed(place, payload)) is not None:
                self.round_trip = arrived - sent
            elif not self._answers.take(place, payload) and place[0] == packets.CONSOLE:
                log.debug("%s says %r", self._name, payload.decode("utf-8", "replace"))

    def _complain(self, message: str) -> None:
        """Note what a driver complains of, in whose thread this runs."""
        self.broken = message.strip().splitlines()[-1] if message.strip() else "unknown"
        log.debug("%s: %s", self.uri, message)
        if threading.get_ident() != self._sender:
            time.sleep(BREATH)

    def _note_quality(self, quality: dict[str, float]) -> None:
        self.quality = dict(quality)
