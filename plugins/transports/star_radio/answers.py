"""Questions to a drone: matching of their answers, and retries."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Self, TypeAlias

from star_radio import packets
from star_radio.round_trip import RoundTrip

MIN_RETRY_PERIOD: Final = 0.2  # s; a radio round trip takes about 10 ms
ATTEMPTS: Final = 10  # after which a question is given up


@dataclass(eq=False, slots=True)
class Question:
    """A packet that requires an answer.

    Attributes:
        packet: Packet to send.
        place: Port and channel of the answer.
        start: First bytes of the answer.
        about: Subject, for messages.
        topic: A newer question of the same topic replaces it; empty for none.
        on_answer: Called with the accepted answer, in the receiving thread.
        accepts: Whether an answer is final; otherwise the question is repeated.
        answer: Payload of the answer; None until then.
        refused: Payload of the last answer that was not accepted.
        due: Time of the next retry, s of the computer's clock.
        left: Number of retries left.
        sendings: Number of transmissions.
        answers: Number of answers.
        done: Set when it is answered.
    """

    packet: bytes
    place: tuple[int, int]
    start: bytes
    about: str
    topic: str = ""
    on_answer: Callable[[bytes], object] = lambda _payload: None
    accepts: Callable[[bytes], bool] = lambda _payload: True
    answer: bytes | None = None
    refused: bytes | None = None
    due: float = 0.0
    left: int = ATTEMPTS
    sendings: int = 0
    answers: int = 0
    done: threading.Event = field(default_factory=threading.Event)

    @classmethod
    def of(cls, packet: bytes, start: bytes, about: str) -> Self:
        """Return a question whose answer comes on the same port and channel."""
        return cls(packet, packets.address(packet[0]), start, about)

    @property
    def unheard(self) -> bool:
        """Whether an earlier transmission may have been executed: an answer is missing."""
        return self.sendings > self.answers


Ask: TypeAlias = Callable[[Sequence[Question]], list[bytes]]
"""Asks questions, blocking; returns the answers or raises `PluginError`."""


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
        """Register a question that is being sent."""
        self.repeat(question)
        question.left -= 1
        with self._lock:
            if question.topic:
                self._open = [other for other in self._open if other.topic != question.topic]
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
        """Drop the questions of a topic."""
        with self._lock:
            self._open = [question for question in self._open if question.topic != topic]

    def take(self, place: tuple[int, int], payload: bytes) -> bool:
        """Match a packet to the oldest question it answers; return whether there was one."""
        with self._lock:
            for question in self._open:
                if question.place == place and payload.startswith(question.start):
                    question.answers += 1
                    if question.accepts(payload):
                        question.answer = payload
                        self._open.remove(question)
                        self._ended.append(question)
                        break
                    question.refused = payload
                    return True
            else:
                return False
        question.on_answer(payload)
        question.done.set()
        return True

    def overdue(self, now: float) -> list[Question]:
        """Return the questions to repeat; a question without retries left is given up."""
        with self._lock:
            late = [question for question in self._open if question.due <= now and question.topic]
            for question in late:
                question.due = now + self.timeout
                question.left -= 1
                if question.left < 0:
                    self._open.remove(question)
                    self._ended.append(question)
                else:
                    question.sendings += 1
        return [question for question in late if question.left >= 0]

    def ended(self) -> list[Question]:
        """Return the questions with a topic that were answered or given up since the last call."""
        with self._lock:
            ended, self._ended = self._ended, []
        return [question for question in ended if question.topic]
