"""A step's conversation with another process, which says through a socket where agents are to fly.

The other process connects to the port by TCP and is sent JSON objects, one a line: a greeting
(`star_external.reports.greeting`), and then a state line a tick or at a rate
(`star_external.reports.state`). It sends goals, or that the step is over or failed
(`star_external.messages`). A line that is wrong is answered ``{"error": why, "line": number}`` and
changes nothing. Each of its lines, also ``{"goals": {}}``, is a sign of life. The connection is
closed when the step ends; the greeting is sent again when other agents are in the step.

In lock-step a simulation waits for exactly one line, right or wrong, in answer to each state line.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal, TypeVar

from star_core import Estimate, Health, InputError, Scene
from star_external.door import LONGEST, Door, Line
from star_external.messages import read
from star_external.planner import Answer, Done, Failed
from star_external.rates import ticks_between
from star_external.reports import greeting, refusal, state
from star_external.source import Hold

End = TypeVar("End", Done, Failed)

log = logging.getLogger(__name__)

LINES: Final = 50
"""Lines that are heard in a tick; what is more waits, and then the sender does."""

ROUNDING: Final = 1e-9
"""What mission time may lack of a whole number of ticks, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner:
    """How the other process is dealt with; as the options say.

    Attributes:
        rate: State lines a second, 1/s; None for one a tick.
        silence: For how long it may say nothing, s.
        then: What to do after that.
        patience: How long it is waited for, s.
        lockstep: Whether a simulation waits for its answers.
    """

    rate: float | None = None
    silence: float = 2.0
    then: Literal["hold", "fail"] = "hold"
    patience: float = 10.0
    lockstep: bool = True


class Conversation:
    """Tells the other process where agents are, and a step what it answers.

    Args:
        scene: The mission's scene.
        door: Where the other process connects.
        manner: How it is dealt with.

    Attributes:
        door: Where the other process connects.
    """

    def __init__(self, scene: Scene, door: Door, manner: Manner) -> None:
        self._scene = scene
        self.door = door
        self._manner = manner
        self._waits = manner.lockstep and not scene.realtime
        self._every = ticks_between(manner.rate, scene.period)
        self._seen_turn: int | None = None  # of the door, when another step held it
        self._visitor: int | None = None  # of the door, the one that is there
        self._greeted: Mapping[str, int] | None = None  # of whom that one was told
        self._owed = False  # in lock-step: an answer
        self._patient = True  # in lock-step: answers are waited for
        self._ticks = 0
        self._begun: float | None = None  # s
        self._heard: float | None = None  # s, when last; None before anybody came
        self._silent = False

    def ask(
        self, estimate: Estimate, health: Health, agents: Mapping[str, int]
    ) -> Iterator[Answer | Hold]:
        if self._begun is None:
            self._begun = estimate.time
        if not self._enter():
            yield from self._queue()
            return
        self.door.turn += 1
        self._meet(estimate, agents)
        if self._heard is None:
            yield from self._wait(estimate.time - self._begun)
            return
        due = self._ticks % self._every == 0
        self._ticks += 1
        if due and not self._owed:
            rows = tuple(agents.values())
            told = self.door.say(state(self._scene, rows, estimate, health), now=True)
            self._owed = self._waits and told
        for line in self._lines():
            match self._understood(line, agents):
                case Done() as done:
                    yield self._leave(done)
                    return
                case Failed(why):
                    yield self._leave(Failed(f"the other process gave up: {why}"))
                    return
                case Mapping() as goals:
                    self._heard, self._silent = estimate.time, False
                    yield goals
        yield from self._after_silence(estimate.time - self._heard, agents)

    def close(self) -> None:
        self.door.close()

    def _enter(self) -> bool:
        """Take the door, unless another step holds it that ran since this one looked last.

        A step that its condition or its time-out ended is not told, and still holds the door.
        """
        door = self.door
        if door.holder not in (None, self) and self._seen_turn != door.turn:
            return False
        if door.holder not in (None, self):
            door.hang_up()
        door.holder = self
        return True

    def _queue(self) -> Iterator[Failed]:
        """Look for a tick whether the step that holds the door still runs."""
        if self._seen_turn is None:
            self._seen_turn = self.door.turn
            return
        host, port = self.door.address
        yield Failed(
            f"another step that runs now listens on {host}:{port}; give each its own 'port'"
        )

    def _meet(self, estimate: Estimate, agents: Mapping[str, int]) -> None:
        """Let the other process in, and greet it."""
        new = self._waits and self._heard is None
        if not self.door.meet(self._manner.patience if new else 0.0):
            return
        if self._visitor == self.door.visitor and self._greeted == agents:
            return
        rate = 1 / (self._every * self._scene.period)
        rows = tuple(agents.values())
        self.door.say(greeting(self._scene, rows, rate, lockstep=self._waits))
        if self._visitor != self.door.visitor:  # who has gone owes nothing any more
            self._visitor = self.door.visitor
            self._owed, self._patient = False, True
        self._greeted = agents
        if self._heard is None:
            self._heard = estimate.time

    def _wait(self, waited: float) -> Iterator[Failed]:
        """Wait for somebody to connect, for so long; `waited` is for how long already, s."""
        patience = self._manner.patience
        if self._waits or waited >= patience - ROUNDING:
            host, port = self.door.address
            yield self._leave(Failed(f"nobody connected to {host}:{port} within {patience:g} s"))

    def _lines(self) -> list[Line]:
        """What was said since the last tick; in lock-step the answer that is owed."""
        if not self._waits:
            return self.door.hear(LINES, 0.0)
        if not self._owed:
            return []
        lines = self.door.hear(1, self._manner.patience if self._patient else 0.0)
        self._patient = bool(lines)
        self._owed = not lines and self.door.connected
        return lines

    def _understood(self, line: Line, agents: Mapping[str, int]) -> Answer | None:
        """What a line says; one that is wrong is answered, and says nothing."""
        why = f"the line is longer than {LONGEST} bytes"
        if line.text is not None:
            try:
                return read(line.text, self._scene, agents)
            except InputError as error:
                why = str(error)
        self.door.say(refusal(why, line.number))
        return None

    def _after_silence(self, lasts: float, agents: Mapping[str, int]) -> Iterator[Failed | Hold]:
        """Without a sign of life for too long, hold or fail; `lasts` is for how long, s."""
        silence = self._manner.silence
        if lasts < silence - ROUNDING:
            return
        if self._manner.then == "fail":
            yield self._leave(Failed(f"nothing was heard of the other process for {silence:g} s"))
        elif not self._silent:
            self._silent = True
            who = ", ".join(agents)
            log.warning("external: the other process says nothing: %s hold their places", who)
            yield Hold()

    def _leave(self, end: End) -> End:
        """Leave the door, for the step is over."""
        self.door.hang_up()
        self.door.holder = None
        return end
