"""One link to a Crazyflie: packets out, and what comes in sorted into answers and reports.

Questions are asked again on every kind of link (cflib does so over radios without safelink only).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Final

from star_core import PluginError
from star_radio import packets
from star_radio.answers import AGAIN_AFTER, Answers, Question
from star_radio.datagrams import SCHEME, Datagrams
from star_radio.driven import Driven
from star_radio.quality import Quality
from star_radio.wire import Wire

log = logging.getLogger(__name__)

BEAT: Final = 0.5  # s without a packet, after which an echo tells the drone that we listen


class Link:
    """Packets to and from one Crazyflie.

    Args:
        uri: Its address, of any kind that cflib has.
        name: Of the agent, for messages.
        datagrams: Where links over UDP are heard; if not given they are cflib's, as the others.

    Attributes:
        uri: As given.
        broken: The wire's last complaint; empty without one. A link may well recover.
        report: Called with every report, and when it arrived, in the thread that hears it.
    """

    def __init__(self, uri: str, name: str, datagrams: Datagrams | None = None) -> None:
        self.uri = uri
        self.broken = ""
        self._name = name
        self._quality = Quality(name)
        self._datagrams = datagrams
        self._wire: Wire | None = None
        self._answers = Answers()
        self.report: Callable[[bytes, float], object] = lambda _payload, _arrived: None
        self._last = 0.0  # s of the computer's clock, when something was sent
        self._closing = False

    def open(self, patience: float) -> None:
        """Begin to carry packets.

        Args:
            patience: How long it may take, s.

        Raises:
            PluginError: The address cannot be had, or nobody is there.
        """
        if self._datagrams is not None and self.uri.startswith(SCHEME):
            try:
                self._wire = self._datagrams.open(self.uri, self)
            except OSError as error:
                raise PluginError(f"{self.uri}: {error}") from error
        else:
            self._wire = Driven(self.uri, self._name, self, patience)

    def post(self, packet: bytes) -> None:
        """Send a packet after those before it, without waiting; a setpoint that waits is void."""
        wire = self._wire
        if wire is not None:
            wire.send(packet)
            self._last = time.monotonic()

    def steer(self, setpoint: bytes) -> None:
        """Send a setpoint without waiting; it takes the place of one that could not be sent yet."""
        wire = self._wire
        if wire is not None:
            wire.steer(setpoint)
            self._last = time.monotonic()

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

    def forget(self, topic: str) -> None:
        """Ask no more about a topic."""
        self._answers.forget(topic)

    def chase(self, now: float) -> list[Question]:
        """Ask again what is not answered at `now`, s of the computer's clock.

        Returns:
            What was answered since the last call, and what is given up: it has no answer.
        """
        for question in self._answers.overdue(now):
            self.post(question.packet)
        return self._answers.ended()

    def close(self) -> None:
        """Carry no more. Safe to call twice."""
        self._closing = True
        wire, self._wire = self._wire, None
        if wire is not None:
            wire.close()

    def hear(self, packet: bytes, arrived: float) -> None:
        place = packets.address(packet[0])
        if place == (packets.LOG, packets.DATA):
            self.report(packet[1:], arrived)
            return
        if packets.is_null(packet[0]):
            return
        payload = packet[1:]
        if not self._answers.take(place, payload) and place[0] == packets.CONSOLE:
            log.debug("%s says %r", self._name, payload.decode("utf-8", "replace"))

    def idle(self, now: float) -> None:
        if now - self._last > BEAT:
            self.post(packets.echo())

    def complain(self, message: str) -> None:
        self.broken = message.strip().splitlines()[-1] if message.strip() else "unknown"
        log.debug("%s: %s", self.uri, self.broken)  # cflib's have tracebacks

    def note_quality(self, quality: dict[str, float]) -> None:
        self._quality.note(quality, time.monotonic())

    def _question(self, packet: bytes, start: bytes, about: str, channel: int | None) -> Question:
        port, own = packets.address(packet[0])
        return Question(packet, (port, own if channel is None else channel), start, about)
