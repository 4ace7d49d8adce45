"""Questions that wait for their answers: who asked, how the answer begins, when to ask again."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

AGAIN_AFTER: Final = 0.2  # s without an answer; a radio's round trip takes some 10 ms
TIMES: Final = 10  # that something is asked before it is given up


@dataclass(eq=False, slots=True)
class Question:
    """A packet that is to be answered.

    Attributes:
        packet: What is sent.
        place: Port and channel that the answer comes on.
        start: How the answer begins.
        about: What it is for, in words.
        topic: A newer question of the same topic takes its place; empty for none.
        accepts: Whether an answer is the last word; one that is not is asked for again.
        answer: The answer's payload; None as long as there is none.
        refused: The payload of the last answer that was not accepted.
        due: When to ask again, s of the computer's clock.
        left: How often that may still be done.
        sendings: How often it was sent.
        answers: How often it was answered.
        done: Set when it is answered.
    """

    packet: bytes
    place: tuple[int, int]
    start: bytes
    about: str
    topic: str = ""
    accepts: Callable[[bytes], bool] = lambda _payload: True
    answer: bytes | None = None
    refused: bytes | None = None
    due: float = 0.0
    left: int = TIMES
    sendings: int = 0
    answers: int = 0
    done: threading.Event = field(default_factory=threading.Event)

    @property
    def unheard(self) -> bool:
        """Whether it may have been carried out before it was answered: an answer is missing."""
        return self.sendings > self.answers


class Answers:
    """The questions of one link that are open; safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: list[Question] = []
        self._ended: list[Question] = []

    def add(self, question: Question) -> None:
        """Wait for the answer of a question that is being sent now."""
        question.due = time.monotonic() + AGAIN_AFTER
        question.left -= 1
        question.sendings += 1
        with self._lock:
            if question.topic:
                self._open = [other for other in self._open if other.topic != question.topic]
            self._open.append(question)

    def drop(self, question: Question) -> None:
        """Wait no longer for an answer."""
        with self._lock:
            if question in self._open:
                self._open.remove(question)

    def forget(self, topic: str) -> None:
        """Wait no longer for an answer about a topic."""
        with self._lock:
            self._open = [question for question in self._open if question.topic != topic]

    def take(self, place: tuple[int, int], payload: bytes) -> bool:
        """Give a packet to the oldest question it answers; return whether there was one."""
        with self._lock:
            for question in self._open:
                if question.place == place and payload.startswith(question.start):
                    question.answers += 1
                    if question.accepts(payload):
                        question.answer = payload
                        self._open.remove(question)
                        self._ended.append(question)
                        question.done.set()
                    else:
                        question.refused = payload
                    return True
        return False

    def overdue(self, now: float) -> list[Question]:
        """Return the questions to ask again; one that was asked often enough is given up."""
        with self._lock:
            late = [question for question in self._open if question.due <= now and question.topic]
            for question in late:
                question.due = now + AGAIN_AFTER
                question.left -= 1
                if question.left < 0:
                    self._open.remove(question)
                    self._ended.append(question)
                else:
                    question.sendings += 1
        return [question for question in late if question.left >= 0]

    def ended(self) -> list[Question]:
        """Return the questions of any topic that were answered or given up since the last call."""
        with self._lock:
            ended, self._ended = self._ended, []
        return [question for question in ended if question.topic]
