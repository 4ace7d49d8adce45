"""The guardian: a process that owns the links and lands the agents if the flight stops answering.

It runs the transport `Radio`; the flight runs in another process, with the mission's plugins, and
reaches it through `star_radio.guarded`. Every message of the flight is its heartbeat. Here are no
plugins, and a session of its own: signals of the terminal do not arrive.
"""

from __future__ import annotations

import logging
import signal
import sys
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import numpy as np

from star_core import Order, Scene, Setpoint, StarError, Transform
from star_radio.descent import Descent
from star_radio.guarded import Answer
from star_radio.transport import Radio

log = logging.getLogger(__name__)

HOVER_AFTER: Final = 0.3  # s without a message of the flight
LAND_AFTER: Final = 1.0  # s
PERIOD: Final = 0.05  # s, between two steps without a message
PROGRESS_PERIOD: Final = 0.2  # s, between two reports while connecting
LAST_TAKEOFF: Final = 2.0  # s after the last message, within which a take-off may begin
MAX_LINES: Final = 100  # log messages that the flight has not received yet
MOVING: Final = ("send", "command", "correct")  # refused once the guardian lands the agents


def serve(descriptor: int) -> None:
    """Serve a flight until it closes the links, or its agents have landed without it.

    Args:
        descriptor: File descriptor of the inherited end of the connection.
    """
    connection, lines = Connection(descriptor), Lines()
    logging.getLogger().addHandler(lines)
    try:
        scene, options = connection.recv()
        guardian = Guardian(scene, Radio(scene, options), connection, lines)
    except StarError as error:
        number, *_call = connection.recv()
        connection.send(Answer(number, (error.message, error.code)))
        return
    for caught in (signal.SIGINT, signal.SIGHUP):
        signal.signal(caught, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_signal: guardian.terminate())
    guardian.run()


class Lines(logging.Handler):
    """Keeps log messages for the flight, with their levels."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._lines: deque[tuple[int, str]] = deque(maxlen=MAX_LINES)

    def emit(self, record: logging.LogRecord) -> None:
        self._lines.append((record.levelno, record.getMessage()))

    def take(self) -> list[tuple[int, str]]:
        """Return those since the last call."""
        return [self._lines.popleft() for _ in range(len(self._lines))]


class Guardian:
    """Serves the transport to a flight, and flies the agents when the flight does not.

    Args:
        scene: The agents and the world.
        radio: Their links.
        connection: To the flight.
        lines: Log messages for it.
    """

    def __init__(self, scene: Scene, radio: Radio, connection: Connection, lines: Lines) -> None:
        self._scene, self._radio, self._connection = scene, radio, connection
        self._lines = lines
        self._heard = time.monotonic()  # s, last message of the flight
        self._gone = self._ended = self._terminated = False
        self._hovers = False
        self._setpoint: Setpoint | None = None
        self._to_map = Transform(
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents]),
        )
        self._descent: Descent | None = None
        self._problem: tuple[str, str] | None = None  # message and code, for the next answer
        self._folder: Path | None = None

    def run(self) -> None:
        """Serve until the end; whatever happens, agents in the air are commanded to land."""
        try:
            while not self._ended:
                self.step()
        finally:
            self._radio.close()

    def step(self) -> None:
        """Handle the next message, if one arrives within `PERIOD`, and do what is due."""
        try:
            if self._gone:
                time.sleep(PERIOD)
            elif self._connection.poll(PERIOD):
                self._handle(*self._connection.recv())
        except (EOFError, OSError):
            self._gone = True
        self._watch(time.monotonic())

    def terminate(self) -> None:
        """Land all agents as soon as one flies; for a signal handler."""
        self._terminated = True

    def _land(self, reason: str) -> None:
        """Land all agents, if any flies; from now on the flight cannot move them."""
        if self._descent is not None:
            return
        flown = [row for row, one in enumerate(self._radio.vehicles) if one.airborne]
        if flown:
            self._log(f"{reason}: landing {self._scene.named(flown)}")
            self._problem = (f"the guardian lands all agents: {reason}", "plugin-failed")
            now = time.monotonic()
            self._descent = Descent(self._radio.vehicles, self._scene, now, self._log)

    def _handle(self, number: int | None, name: str, argument: Any) -> None:
        """Act on a message; it is answered if it has a number."""
        self._heard = time.monotonic()
        if self._hovers and self._descent is None:
            self._hovers = False
            self._log("the flight answers again")
        stops = name == "command" and argument.order is Order.STOP
        if self._descent is not None and name in MOVING and not stops:
            return
        value = None
        try:
            value = getattr(self, f"_{name}")(argument)
        except StarError as error:
            self._problem = error.message, error.code
        except Exception as error:  # it must not end the guardian
            log.exception("guardian: %s", name)
            self._problem = f"{type(error).__name__}: {error}", "plugin-failed"
        self._heard = time.monotonic()
        if number is not None:
            problem, self._problem = self._problem, None
            self._connection.send(Answer(number, problem, value, self._lines.take()))

    def _connect(self, _none: None) -> None:
        self._working(self._radio.connect, shown=False)

    def _upload(self, trajectories: Any) -> None:
        self._working(self._radio.upload, trajectories)

    def _working(self, work: Any, *arguments: Any, **how: Any) -> None:
        """Do something that takes long, and report its progress to the flight."""
        with ThreadPoolExecutor(1) as pool:
            working = pool.submit(work, *arguments, **how)
            while wait([working], PROGRESS_PERIOD).not_done:
                value = self._radio.progress.done, self._radio.settling()
                self._connection.send(Answer(None, value=value))
        working.result()

    def _wait(self, until: float) -> Any:
        self._radio.wait(until)
        return self._radio.began, self._radio.connected, self._radio.receive()

    def _send(self, message: tuple[Setpoint, Transform]) -> None:
        self._setpoint, self._to_map = message
        self._radio.send(self._setpoint)

    def _command(self, command: Any) -> None:
        self._radio.command(command)

    def _correct(self, corrections: Any) -> None:
        self._radio.correct(corrections)

    def _record_in(self, folder: Path) -> None:
        self._folder = folder

    def _close(self, _none: None) -> None:
        while self._descent is not None and not self._descent.over:
            time.sleep(PERIOD)
            self._fly(time.monotonic())
        self._radio.close()
        self._ended = True

    def _watch(self, now: float) -> None:
        """Fly the agents if the flight does not."""
        silent = now - self._heard
        if self._gone:
            self._land("the flight has ended without closing its links")
        elif self._terminated:
            self._land("SIGTERM")
        elif silent >= LAND_AFTER:
            self._land(f"no message of the flight for {silent:.2f} s")
        if self._descent is not None:
            self._fly(now)
            self._ended |= self._gone and self._descent.over
        elif self._gone:
            self._radio.wait(0.0)
            self._ended |= silent > LAST_TAKEOFF
        elif silent >= HOVER_AFTER:
            self._hover(silent)

    def _hover(self, silent: float) -> None:
        """Stop agents flown by setpoints; on-board commanders finish what they fly."""
        if self._setpoint is None:
            return
        steered = np.array([vehicle.steered for vehicle in self._radio.vehicles])
        active = self._setpoint.active & steered
        if not active.any():
            return
        if not self._hovers:
            self._hovers = True
            names = self._scene.named(np.flatnonzero(active))
            self._log(f"no message of the flight for {silent:.2f} s: {names} hover")
        self._radio.wait(0.0)
        still = np.zeros_like(self._setpoint.velocity)
        self._radio.send(Setpoint(still, self._setpoint.yaw, active))

    def _fly(self, now: float) -> None:
        """Continue the landings."""
        descent = self._descent
        if descent is None or descent.over:
            return
        self._radio.wait(0.0)
        setpoint = descent.step(now, self._radio.receive(), self._to_map)
        if setpoint.active.any():
            self._radio.send(setpoint)

    def _log(self, text: str) -> None:
        """Write a line to stderr, and to ``guardian.log`` in the folder of the run."""
        now = time.monotonic()
        with suppress(OSError, ValueError):  # the terminal is gone
            sys.stderr.write(f"star: guardian: {text}\n")
            sys.stderr.flush()
        if self._folder is not None:
            with suppress(OSError), (self._folder / "guardian.log").open("a") as file:
                file.write(f"{now - (self._radio.began or now):8.2f} s  {text}\n")
