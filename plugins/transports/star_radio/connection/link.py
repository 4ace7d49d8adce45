"""Link to one Crazyflie: sends packets and sorts received ones into answers and reports.

Requests are retried on every kind of link (cflib does so only over radios without safelink).
"""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from threading import Event
from typing import Final

from star_core import PluginError
from star_radio.connection import packets
from star_radio.connection.cflib_link import CflibLink
from star_radio.connection.packets import LinkDriver
from star_radio.connection.questions import ATTEMPTS, Answers, Question, RoundTrip
from star_radio.connection.udp_links import SCHEME, UdpLinks

log = logging.getLogger(__name__)

MIN_QUALITY: Final = 70.0  # %: three of ten transmissions fail; chosen, not measured
MIN_DURATION: Final = 2.0  # s below it, before the warning
ECHO_PERIOD: Final = 0.5  # s without a sent packet, after which an echo keeps the link alive
UDP_ECHO_PERIOD: Final = 0.09  # s, likewise over UDP, where no dongle polls: without any packet for
# 1 s the firmware deletes its log blocks, and at 20 % loss two echoes a second are too few
MAX_ECHOES: Final = 300  # that are remembered
WINDOW: Final = 12  # simultaneously open requests; the firmware queues 16 packets per port


class Link:
    """Packets to and from one Crazyflie.

    Args:
        uri: Its address, of any kind that cflib supports.
        name: Name of the agent, for messages.
        udp_links: Handler of UDP links; if not given, cflib handles them as it does the others.

    Attributes:
        uri: As given.
        broken: The driver's last error message; empty without one. A link may recover.
        report: Called with every report and its arrival time, in the receiving thread.
        echoes: When the newest echoes that came back were sent, s of the computer's clock.
    """

    def __init__(self, uri: str, name: str, udp_links: UdpLinks | None = None) -> None:
        self.uri = uri
        self.broken = ""
        self._name = name
        self._quality = Quality(name)
        self._udp_links = udp_links
        self._driver: LinkDriver | None = None
        self._answers = Answers()
        self.report: Callable[[bytes, float], object] = lambda _payload, _arrived: None
        self.echoes: deque[float] = deque(maxlen=MAX_ECHOES)
        self._last = 0.0  # s of the computer's clock, of the last sent packet
        self._measured = 0.0  # s of the computer's clock, of the last echo request
        self._closing = False

    def open(self, timeout: float) -> None:
        """Open the link within `timeout`, s."""
        if self._udp_links is not None and self.uri.startswith(SCHEME):
            try:
                self._driver = self._udp_links.open(self.uri, self)
            except OSError as error:
                raise PluginError(f"{self.uri}: {error}", "link-failed") from error
        else:
            self._driver = CflibLink(self.uri, self._name, self, timeout)

    def post(self, packet: bytes) -> None:
        """Queue a packet, without blocking; this drops a setpoint that is still queued."""
        driver = self._driver
        if driver is not None:
            driver.send(packet)
            self._last = time.monotonic()

    def steer(self, setpoint: bytes) -> None:
        """Queue a setpoint, without blocking; it replaces one that is still queued."""
        driver = self._driver
        if driver is not None:
            driver.steer(setpoint)
            self._last = time.monotonic()

    @property
    def quality(self) -> float:
        """Newest quality that the dongle reports, %; NaN of a link without a dongle."""
        return self._quality.percent

    @property
    def round_trip(self) -> RoundTrip:
        """Measured while requests are open and while the link is idle."""
        return self._answers.round_trip

    def ask_all(
        self, questions: Sequence[Question], *, timeout: float, deadline: float = math.inf
    ) -> list[bytes]:
        """Ask several questions, up to `WINDOW` at a time, until all are answered.

        Args:
            questions: Independent of each other.
            timeout: For each question, s; longer on links with a long round trip, so that a
                question is asked `ATTEMPTS` times.
            deadline: For all of them, s of the computer's clock.

        Returns:
            The payload of each accepted answer.
        """
        waiting = deque(questions)
        begun: dict[Question, float] = {}  # s, when each open question was asked first
        answered = Event()
        try:
            while waiting or begun:
                now = time.monotonic()
                self._measure(now)
                while waiting and len(begun) < WINDOW:
                    question = waiting.popleft()
                    question.done = answered
                    begun[question] = now
                    self._answers.add(question)
                    self.post(question.packet)
                wait = max(timeout, ATTEMPTS * self.round_trip.timeout)
                for question, first in begun.items():
                    if now >= min(first + wait, deadline) or self._closing:
                        raise self._unanswered(question, wait, late=now >= deadline)
                    if now >= question.due:
                        self._answers.repeat(question)
                        self.post(question.packet)
                wake = min(min(question.due, first + wait) for question, first in begun.items())
                answered.wait(max(0.0, min(wake, deadline) - time.monotonic()))
                answered.clear()
                begun = {
                    question: first for question, first in begun.items() if question.answer is None
                }
        finally:
            for question in begun:
                self._answers.drop(question)
        return [question.answer or b"" for question in questions]

    def assure(self, question: Question, *, sent: bool = False) -> None:
        """Repeat a question that has a topic in `retry` until it is answered.

        It is sent first, unless it has already been `sent` by other means.
        """
        self._answers.add(question)
        if not sent:
            self.post(question.packet)

    def forget(self, topic: str) -> None:
        """Drop open questions whose topics begin with `topic`."""
        self._answers.forget(topic)

    def retry(self, now: float) -> list[Question]:
        """Repeat questions that are overdue at `now`, s of the computer's clock.

        Returns the questions answered since the last call, and those given up (without an answer).
        """
        for question in self._answers.overdue(now):
            self.post(question.packet)
        return self._answers.ended()

    def close(self) -> None:
        """Close the link. Safe to call twice."""
        self._closing = True
        driver, self._driver = self._driver, None
        if driver is not None:
            driver.close()

    def hear(self, packet: bytes, arrived: float) -> None:
        port = packets.address(packet[0])
        if port == (packets.LOG, packets.DATA):
            self.report(packet[1:], arrived)
            return
        if packets.is_null(packet[0]):
            return
        payload = packet[1:]
        if port == (packets.LINK, 0):
            if (sent := packets.echoed(payload)) is not None:
                self.echoes.append(sent)
                self._answers.round_trip.note(arrived - sent)
            return
        if not self._answers.take(port, payload) and port[0] == packets.CONSOLE:
            log.debug("%s: console: %r", self._name, payload.decode("utf-8", "replace"))

    def idle(self, now: float) -> None:
        period = UDP_ECHO_PERIOD if self.uri.startswith(SCHEME) else ECHO_PERIOD
        if now - self._last > period:
            self.post(packets.echo(now))

    def complain(self, message: str) -> None:
        self.broken = message.strip().splitlines()[-1] if message.strip() else "unknown"
        log.debug("%s: %s", self.uri, self.broken)  # last line only: cflib adds tracebacks

    def note_quality(self, quality: dict[str, float]) -> None:
        self._quality.note(quality, time.monotonic())

    def _measure(self, now: float) -> None:
        """Measure the round trip if the last measurement is old at `now`, s."""
        if now - self._measured > ECHO_PERIOD:
            self._measured = now
            self.post(packets.echo(now))

    def _unanswered(self, question: Question, wait: float, *, late: bool) -> PluginError:
        if late:
            return PluginError(f"{self.uri} is too slow: it is not connected in time", "no-answer")
        why = f" ({self.broken})" if self.broken else ""
        if question.refused is not None:
            why = f", but {question.refused.hex()!r}"
        about = f"no answer about {question.about}"
        return PluginError(f"{about} from {self.uri} in {wait:.3g} s{why}", "no-answer")


class Quality:
    """Warns once when the quality of a Crazyradio's link to an agent stays low.

    Attributes:
        percent: The newest quality, %; NaN before the first.
    """

    def __init__(self, name: str) -> None:
        self.percent = math.nan
        self._name = name
        self._since = math.inf  # s, time since which it is low
        self._warned = False

    def note(self, quality: dict[str, float], now: float) -> None:
        """Add cflib's link statistics at `now`, s; runs in the thread of the driver."""
        percent = quality.get("link_quality")  # 100 minus ten times the mean retries per packet
        if percent is None:
            return
        self.percent = percent
        if self._warned:
            return
        self._since = min(self._since, now) if percent < MIN_QUALITY else math.inf
        if now - self._since >= MIN_DURATION:
            self._warned = True
            log.warning(
                "radio: the link of %s is weak: its quality is %.0f %%, below %g %% for %g s",
                *(self._name, percent, MIN_QUALITY, MIN_DURATION),
            )
