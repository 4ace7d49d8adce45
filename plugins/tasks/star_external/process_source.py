"""Goals from another process, through a TCP socket.

The other process connects to the port and is sent JSON objects, one per line: a greeting
(`star_external.protocol.greeting`), and then state lines, every tick or at a rate
(`star_external.protocol.state`). It sends goals, or the success or failure of the step
(`star_external.protocol`). An invalid line is answered with ``{"error": why, "line": number}`` and
otherwise ignored. Every valid line, also ``{"goals": {}}``, restarts the silence timeout. The
connection is closed when the step ends; the greeting is repeated when the agents of the step
change.

In lock-step a simulation waits for exactly one line, valid or not, in answer to each state line.
"""

from __future__ import annotations

import logging
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Final, Literal, TypeVar

from star_core import Estimate, Health, InputError, Scene
from star_core.toolkit import shortlist
from star_external.external import Hold
from star_external.planner import Answer, Done, Failed
from star_external.protocol import greeting, read, refusal, state, ticks_between
from star_external.tcp_server import MAX_LINE, Line, TcpServer

End = TypeVar("End", Done, Failed)

log = logging.getLogger(__name__)

MAX_LINES: Final = 50  # read per tick; others wait in the buffers, which finally block the sender
NUMBER: Final = re.compile(r"-?\d[\d.e+-]*")
ROUNDING: Final = 1e-9  # s: tolerance of mission time against a whole number of ticks


class ProcessSource:
    """Sends the other process the state of the agents, and passes its answers to the step.

    Args:
        scene: The mission's scene.
        server: Server that the other process connects to.
        rate: State lines per second, 1/s; None for every tick.
        max_silence: Maximum time without a line, s.
        on_silence: What to do after that.
        response_timeout: Time to wait for the connection and for each answer, s.
        lockstep: Whether a simulation waits for answers.

    Attributes:
        server: As given.
        messages: For the log, until the step takes them.
    """

    def __init__(
        self,
        scene: Scene,
        server: TcpServer,
        *,
        rate: float | None,
        max_silence: float,
        on_silence: Literal["hold", "fail"],
        response_timeout: float,
        lockstep: bool,
    ) -> None:
        self._scene = scene
        self.server = server
        self._max_silence = max_silence
        self._on_silence = on_silence
        self._response_timeout = response_timeout
        self._waits = lockstep and not scene.realtime
        self._every = ticks_between(rate, scene.period)
        self._last_turn: int | None = None  # of the server, when another step held it
        self._client_count: int | None = None  # of the server, at the last greeting
        self._greeted: Mapping[str, int] | None = None  # agents of the last greeting
        self._owed = False  # in lock-step: whether an answer is outstanding
        self._patient = True  # in lock-step: whether to wait for answers
        self._ticks = 0
        self._begun: float | None = None  # s
        self._heard: float | None = None  # s, last line; None before a client connected
        self._silent = False
        self._rejected: Counter[str] = Counter()  # lines by their error, without its numbers
        self.messages: list[str] = []

    def poll(
        self, estimate: Estimate, health: Health, agents: Mapping[str, int]
    ) -> Iterator[Answer | Hold]:
        if self._begun is None:
            self._begun = estimate.time
            if not self.server.accept(0.0):
                # Not a message of the step: in lock-step it would come after the wait.
                host, port = self.server.address
                log.warning("external: listening on %s:%d, waiting for a client", host, port)
        if not self._enter():
            yield from self._queue()
            return
        self.server.turn += 1
        self._meet(estimate, agents)
        if self._heard is None:
            yield from self._wait(estimate.time - self._begun)
            return
        due = self._ticks % self._every == 0
        self._ticks += 1
        if due and not self._owed:
            rows = tuple(agents.values())
            sent = self.server.send(state(self._scene, rows, estimate, health), now=True)
            self._owed = self._waits and sent
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
        self.server.close()

    def _enter(self) -> bool:
        """Take the server, unless its holder has run since the last check.

        A step that was ended by a condition or its timeout is not notified and still holds it.
        """
        server = self.server
        if server.holder not in (None, self) and self._last_turn != server.turn:
            return False
        if server.holder not in (None, self):
            server.disconnect()
        server.holder = self
        return True

    def _queue(self) -> Iterator[Failed]:
        """Check for one tick whether the step that holds the server is still running."""
        if self._last_turn is None:
            self._last_turn = self.server.turn
            return
        host, port = self.server.address
        yield Failed(
            f"another running step listens on {host}:{port}; give each step its own 'port'"
        )

    def _meet(self, estimate: Estimate, agents: Mapping[str, int]) -> None:
        """Accept the other process, and greet it."""
        new = self._waits and self._heard is None
        if not self.server.accept(self._response_timeout if new else 0.0):
            return
        if self._client_count == self.server.client_count and self._greeted == agents:
            return
        rate = 1 / (self._every * self._scene.period)
        rows = tuple(agents.values())
        self.server.send(greeting(self._scene, rows, rate, lockstep=self._waits))
        if self._client_count != self.server.client_count:  # a new client owes no answer
            self._client_count = self.server.client_count
            self._owed, self._patient = False, True
        self._greeted = agents
        if self._heard is None:
            self._heard = estimate.time

    def _wait(self, waited: float) -> Iterator[Failed]:
        """Fail if no client has connected in time; `waited` is the time so far, s."""
        timeout = self._response_timeout
        if self._waits or waited >= timeout - ROUNDING:
            host, port = self.server.address
            yield self._leave(Failed(f"no client connected to {host}:{port} within {timeout:g} s"))

    def _lines(self) -> list[Line]:
        """Return the lines since the last tick; in lock-step the outstanding answer."""
        if not self._waits:
            return self.server.receive(MAX_LINES, 0.0)
        if not self._owed:
            return []
        lines = self.server.receive(1, self._response_timeout if self._patient else 0.0)
        self._patient = bool(lines)
        self._owed = not lines and self.server.connected
        return lines

    def _understood(self, line: Line, agents: Mapping[str, int]) -> Answer | None:
        """Return the content of a line; answer an invalid one with an error."""
        why = f"the line is longer than {MAX_LINE} bytes"
        if line.text is not None:
            try:
                return read(line.text, self._scene, agents)
            except InputError as error:
                why = str(error)
        self.server.send(refusal(why, line.number))
        self._report_rejected(why, line.number)
        return None

    def _report_rejected(self, why: str, number: int) -> None:
        """Report an invalid line if it is the first with such an error, the tenth, hundredth ..."""
        kind = NUMBER.sub("0", why)
        self._rejected[kind] += 1
        count = self._rejected[kind]
        if count == 1:
            self.messages.append(f"rejected line {number}: {why}")
        elif math.log10(count).is_integer():
            self.messages.append(f"rejected {count} such lines so far, the last: {why}")

    def _after_silence(self, lasts: float, agents: Mapping[str, int]) -> Iterator[Failed | Hold]:
        """Hold or fail if no line has arrived for too long; `lasts` is the time since, s."""
        silence = self._max_silence
        if lasts < silence - ROUNDING:
            return
        if self._on_silence == "fail":
            yield self._leave(Failed(f"the other process sent nothing for {silence:g} s"))
        elif not self._silent:
            self._silent = True
            names = shortlist(agents)
            log.warning("external: the other process sends nothing: %s hold position", names)
            yield Hold()

    def _leave(self, end: End) -> End:
        """Release the server at the end of the step."""
        self.server.disconnect()
        self.server.holder = None
        return end
