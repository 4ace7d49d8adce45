"""Questions to a drone: matching of their answers, retries, and the round-trip time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Self, TypeAlias

from star_radio.connection import packets

MIN_RETRY_PERIOD: Final = 0.2  # s; a radio round trip takes about 10 ms
ATTEMPTS: Final = 10  # after which a question is given up
MAX_ROUND_TRIP: Final = 5.0  # s
MARGIN: Final = 0.05  # s above the mean round trip, at least: reports delay answers


@dataclass(eq=False, slots=True)
class Question:
    """A packet that requires an answer.

    Attributes:
        packet: Packet to send.
        port: Port and channel of the answer.
        start: First bytes of the answer.
        about: Subject, for messages.
        topic: A newer question of the same topic replaces it; empty for none.
        on_answer: Called with the accepted answer, in the receiving thread.
        accepts: Whether an answer is final; otherwise the question is repeated.
        answer: Payload of the answer; None until then.
        refused: Payload of the last answer that was not accepted.
        due: Time of the next retry, s of the computer's clock.
        retries: Number of retries that remain.
        sendings: Number of transmissions.
        answers: Number of answers.
        done: Set when it is answered.
    """

    packet: bytes
    port: tuple[int, int]
    start: bytes
    about: str
    topic: str = ""
    on_answer: Callable[[bytes], object] = lambda _payload: None
    accepts: Callable[[bytes], bool] = lambda _payload: True
    answer: bytes | None = None
    refused: bytes | None = None
    due: float = 0.0
    retries: int = ATTEMPTS
    sendings: int = 0
    answers: int = 0
    done: threading.Event = field(default_factory=threading.Event)

    @classmethod
    def of(cls, packet: bytes, start: bytes, about: str, *, topic: str = "") -> Self:
        """Return a question whose answer comes on the same port and channel."""
        return cls(packet, packets.address(packet[0]), start, about, topic)

    @property
    def unheard(self) -> bool:
        """Whether an earlier transmission may have been executed: an answer is missing."""
        return self.sendings > self.answers


Ask: TypeAlias = Callable[[Sequence[Question]], list[bytes]]
"""Asks questions, blocking; returns the answers or raises `PluginError`."""


class RoundTrip:
    """Mean and mean deviation of round-trip times, smoothed as TCP does (RFC 6298, section 2)."""

    def __init__(self) -> None:
        self._mean: float | None = None  # s
        self._deviation = 0.0  # s

    def note(self, time: float) -> None:
        """Add a measured round-trip time, s; a time that no echo can take is ignored.

        >>> trip = RoundTrip()
        >>> trip.note(-1.0)
        >>> trip.note(float("nan"))
        >>> trip.timeout
        0.0
        """
        if not 0 <= time <= MAX_ROUND_TRIP:  # of an altered echo, or another program's
            return
        if self._mean is None:
            self._mean, self._deviation = time, time / 2
            return
        self._deviation += (abs(time - self._mean) - self._deviation) / 4
        self._mean += (time - self._mean) / 8

    @property
    def timeout(self) -> float:
        """Time after which an answer counts as lost, s; 0 before the first measurement.

        >>> trip = RoundTrip()
        >>> trip.note(0.3)
        >>> round(trip.timeout, 9)
        0.9
        """
        return 0.0 if self._mean is None else self._mean + max(MARGIN, 4 * self._deviation)


class Answers:
    """Open questions of one link; thread-safe.

    Attributes:
        round_trip: Round-trip times of the link.
    """

    def __init__(self) -> None:
        self.round_trip = RoundTrip()
        self._lock = threading.Lock()
        self._open: list[Question] = []
        self._ended: list[Question] = []

    @property
    def timeout(self) -> float:
        """Time without an answer after which to retry, s."""
        return max(MIN_RETRY_PERIOD, self.round_trip.timeout)

    def add(self, question: Question) -> None:
        """Register a question that is being sent; it replaces those of its topic."""
        self.repeat(question)
        question.retries -= 1
        with self._lock:
            self._open = [
                other for other in self._open if not (other.topic and other.topic == question.topic)
            ]
            self._open.append(question)

    def repeat(self, question: Question) -> None:
        """Register another transmission of a question."""
        question.due = time.monotonic() + self.timeout
        question.sendings += 1

    def drop(self, question: Question) -> None:
        """Drop a question."""
        with self._lock:
            if question in self._open:
                self._open.remove(question)

    def forget(self, topic: str) -> None:
        """Drop the questions whose topics begin with `topic`, and their answers."""
        with self._lock:
            self._open, self._ended = (
                [each for each in questions if not each.topic.startswith(topic)]
                for questions in (self._open, self._ended)
            )

    def take(self, port: tuple[int, int], payload: bytes) -> bool:
        """Match a packet to the oldest question it answers; return whether there was one."""
        with self._lock:
            matches = (
                question
                for question in self._open
                if question.port == port and payload.startswith(question.start)
            )
            question = next(matches, None)
            if question is None:
                return False
            question.answers += 1
            if not question.accepts(payload):
                question.refused = payload
                return True
            question.answer = payload
            self._open.remove(question)
            self._ended.append(question)
        question.on_answer(payload)
        question.done.set()
        return True

    def overdue(self, now: float) -> list[Question]:
        """Return the questions to repeat at `now`, s; those without retries are given up."""
        with self._lock:
            late = [question for question in self._open if question.due <= now and question.topic]
            for question in late:
                question.due = now + self.timeout
                question.retries -= 1
                question.sendings += question.retries >= 0
                if question.retries < 0:
                    self._open.remove(question)
                    self._ended.append(question)
        return [question for question in late if question.retries >= 0]

    def ended(self) -> list[Question]:
        """Return the questions with a topic that were answered or given up since the last call."""
        with self._lock:
            ended, self._ended = self._ended, []
        return [question for question in ended if question.topic]
