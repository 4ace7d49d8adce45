"""A link whose driver blocks, fails or lies delays neither the flight nor other links."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import cflib.crtp
import pytest
from cflib.crtp.crtpstack import CRTPPacket

from star_core import PluginError
from star_radio.connection import packets
from star_radio.connection.link import WINDOW, Link, Quality
from star_radio.connection.questions import Question
from star_radio.connection.udp_links import UdpLinks
from tests.waiting import eventually


class Driver:
    """A driver of cflib's that does what a test wants."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.go = threading.Event()
        self.go.set()
        self.error: Callable[[str], None] = lambda _message: None
        self.fails = ""
        self.opening = 0.0  # s
        self.closed = False
        self.inbox: list[CRTPPacket] = []

    def connect(self, uri: str, quality: object, error: Callable[[str], None]) -> None:
        time.sleep(self.opening)
        self.error = error

    def send_packet(self, packet: CRTPPacket) -> None:
        self.go.wait(5)
        if self.fails:
            raise OSError(self.fails)
        self.sent.append(bytes([packet.header & 0xF3]) + bytes(packet.data))

    def receive_packet(self, wait: float) -> CRTPPacket | None:
        if self.inbox:
            return self.inbox.pop(0)
        time.sleep(wait / 10)
        return None

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Driver:
    driver = Driver()
    monkeypatch.setattr(cflib.crtp, "CLASSES", [lambda: driver])
    return driver


@pytest.fixture
def link(driver: Driver) -> Iterator[Link]:
    with ExitStack() as stack:
        link = Link("usb://0", "cf1", UdpLinks())
        link.open(1.0)
        stack.callback(link.close)
        stack.callback(driver.go.set)
        yield link


def order(number: int) -> bytes:
    return bytes([0x8C, number])


def setpoint(number: int) -> bytes:
    return bytes([0x7C, number])


def test_a_link_that_blocks_delays_no_other(driver: Driver, link: Link) -> None:
    driver.go.clear()
    begun = time.monotonic()
    for number in range(100):
        link.steer(setpoint(number))
        link.post(order(number))
    assert time.monotonic() - begun < 1


def test_the_latest_setpoint_is_sent_when_a_link_goes_on(driver: Driver, link: Link) -> None:
    driver.go.clear()
    link.post(order(0))
    time.sleep(0.05)
    for number in range(1, 4):
        link.steer(setpoint(number))
    driver.go.set()
    assert eventually(lambda: len(driver.sent) == 2)
    assert driver.sent == [b"\x80\0", b"\x70\3"]


def test_a_setpoint_that_waits_is_void_after_an_order(driver: Driver, link: Link) -> None:
    driver.go.clear()
    link.post(order(0))
    time.sleep(0.05)
    link.steer(setpoint(1))
    link.post(order(2))
    link.post(order(3))
    driver.go.set()
    assert eventually(lambda: len(driver.sent) == 3)
    assert driver.sent == [b"\x80\0", b"\x80\2", b"\x80\3"]


def test_a_driver_that_raises_is_noted(driver: Driver, link: Link) -> None:
    driver.fails = "unplugged"
    link.post(order(0))
    assert eventually(lambda: link.broken == "unplugged")


def test_driver_errors_are_reported_with_the_missing_answer(driver: Driver, link: Link) -> None:
    threading.Thread(target=driver.error, args=("CommandFailure\nToo many packets lost",)).start()
    assert eventually(lambda: bool(link.broken))
    with pytest.raises(
        PluginError, match=r"about it from usb://0 in 0.05 s \(Too many packets lost\)"
    ):
        link.ask_all([Question.of(order(0), b"\0", "it")], timeout=0.05)


def test_links_that_open_too_late_are_closed_then(driver: Driver) -> None:
    driver.opening = 0.3
    with pytest.raises(PluginError, match=r"usb://0: not opened in 0.05 s"):
        Link("usb://0", "cf1", UdpLinks()).open(0.05)
    assert eventually(lambda: driver.closed)


def test_a_link_that_stays_weak_is_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    quality = Quality("cf1")
    quality.note({"uplink_rssi": 40.0}, 0.0)
    for now, percent in enumerate((60.0, 60.0, 80.0, 60.0, 60.0)):  # it recovers in time
        quality.note({"link_quality": percent}, float(now))
    assert caplog.text == ""
    for later in (5.0, 6.0):
        quality.note({"link_quality": 65.0}, later)
    weak = "radio: the link of cf1 is weak: its quality is 65 %, below 70 % for 2 s"
    assert caplog.messages == [weak]


def test_a_complaint_with_a_traceback_is_one_line(
    link: Link, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    link.complain("Error communicating\n\nTraceback (most recent call last):\n  x\nOSError: gone\n")
    assert caplog.messages == ["usb://0: OSError: gone"]


def test_an_answer_is_known_by_its_beginning(driver: Driver, link: Link) -> None:
    for header, data in ((0x5D, b"\7\1\0"), (0x5C, b"\6\1\0"), (0x51, b"\6\1\5")):
        driver.inbox.append(CRTPPacket(header, data))
    question = Question.of(b"\x5d\6\1", b"\6\1", "it")
    assert link.ask_all([question], timeout=1.0) == [b"\6\1\5"]


def test_only_the_newest_question_of_a_topic_is_asked_again(driver: Driver, link: Link) -> None:
    for number in (1, 2):
        link.assure(Question(order(number), (8, 0), bytes([number]), "it", topic="order"))
    assert eventually(lambda: not link.retry(time.monotonic()) and len(driver.sent) == 3)
    assert driver.sent == [b"\x80\1", b"\x80\2", b"\x80\2"]


def test_a_link_that_is_closed_sends_nothing(driver: Driver, link: Link) -> None:
    link.close()
    link.close()
    link.post(order(0))
    assert driver.closed
    assert driver.sent == []


def test_a_slow_round_trip_delays_repetition(driver: Driver, link: Link) -> None:
    now = time.monotonic()
    echo = packets.echo(now)
    link.hear(echo, now + 0.3)
    assert link.round_trip.timeout == pytest.approx(0.9)
    link.assure(Question(order(1), (8, 0), b"\1", "it", topic="order"))
    for later, sent in ((0.5, 1), (1.0, 2), (1.5, 2), (2.0, 3)):
        link.retry(now + later)
        assert eventually(lambda sent=sent: driver.sent.count(b"\x80\1") == sent)
    assert driver.sent.count(b"\x80\1") == 3


def test_a_slow_round_trip_needs_more_patience(link: Link) -> None:
    now = time.monotonic()
    for _time in range(20):
        link.hear(packets.echo(now), now)  # 0.05 s, the least margin, ten times
    with pytest.raises(PluginError, match=r"no answer about it from usb://0 in 0.5 s"):
        link.ask_all([Question.of(order(0), b"\0", "it")], timeout=0.01)


def test_an_answer_that_is_not_accepted_is_passed_over(driver: Driver, link: Link) -> None:
    question = Question.of(order(1), b"\1", "it")
    question.accepts = lambda payload: payload == b"\1\2"
    driver.inbox += [CRTPPacket(0x80, b"\1\1"), CRTPPacket(0x80, b"\1\2")]
    assert link.ask_all([question], timeout=2.0) == [b"\1\2"]


def test_the_answer_that_was_not_accepted_is_named(driver: Driver, link: Link) -> None:
    question = Question.of(order(1), b"\1", "it")
    question.accepts = lambda _payload: False
    driver.inbox.append(CRTPPacket(0x80, b"\1\1"))
    with pytest.raises(PluginError, match=r"no answer about it from usb://0 in 0.3 s, but '0101'"):
        link.ask_all([question], timeout=0.3)


def test_questions_are_asked_together(driver: Driver, link: Link) -> None:
    questions = [Question.of(order(number), bytes([number]), "it") for number in range(30)]
    answered = threading.Thread(target=lambda: link.ask_all(questions, timeout=5.0))
    answered.start()
    assert eventually(lambda: sum(sent[0] == 0x80 for sent in driver.sent) == WINDOW)
    while answered.is_alive():
        sent = [packet[1:] for packet in driver.sent if packet[0] == 0x80]
        driver.inbox += [CRTPPacket(0x80, payload) for payload in reversed(sent)]
        answered.join(0.05)
    assert [question.answer for question in questions] == [bytes([n]) for n in range(30)]


def test_a_closed_link_answers_nothing(link: Link) -> None:
    link.close()
    with pytest.raises(PluginError, match="no answer about it from usb://0"):
        link.ask_all([Question.of(order(0), b"\0", "it")], timeout=5.0)
