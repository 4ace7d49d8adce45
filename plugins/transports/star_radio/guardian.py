"""The guardian: a process that owns the links and lands the agents if the flight stops answering.

It runs the transport `Radio`; the flight runs in another process, with the mission's plugins, and
reaches it through `star_radio.guarded`. Every message of the flight is its heartbeat. Here are no
plugins, and a session of its own: signals of the terminal do not arrive.

After the flight it stays for agents that may be in the air, and lands them when their links return.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import numpy as np

from star_core import Command, ContractError, Order, Scene, Setpoint, StarError, Transform
from star_radio.descent import Descent
from star_radio.guarded import Answer
from star_radio.mailbox import Mailbox
from star_radio.transport import Radio

log = logging.getLogger(__name__)

HOVER_AFTER: Final = 0.3  # s without a message of the flight
LAND_AFTER: Final = 1.0  # s
PERIOD: Final = 0.05  # s, between two steps without a message
PROGRESS_PERIOD: Final = 0.2  # s, between two reports while connecting
LANDING_TIME: Final = 30.0  # s, for which the end of the flight waits for landings
MAX_LINES: Final = 100  # log messages that the flight has not received yet
MAX_WAIT: Final = 1.0  # s, for a tick
MOVING: Final = ("send", "command", "correct", "set_parameters")
"""Refused once the guardian lands the agents."""


def serve(descriptor: int) -> None:
    """Serve a flight until it closes the links, or its agents have landed without it.

    Args:
        descriptor: File descriptor of the inherited end of the connection.
    """
    connection, lines = Mailbox(Connection(descriptor)), Lines()
    logging.getLogger().addHandler(lines)
    try:
        scene, options = connection.recv()
        radio = Radio(scene, options)
        guardian = Guardian(scene, radio, connection, lines, options.landing_timeout)
    except StarError as error:
        number, _name, _argument = connection.recv()
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

    After the flight it lands agents for at most `landing_timeout`, s.
    """

    def __init__(
        self,
        scene: Scene,
        radio: Radio,
        connection: Mailbox,
        lines: Lines,
        landing_timeout: float = np.inf,
    ) -> None:
        self._scene, self._radio, self._connection = scene, radio, connection
        self._lines = lines
        self._heard = time.monotonic()  # s, last message of the flight
        self._landing_timeout = landing_timeout
        self._over_since: float | None = None  # s, end of the flight
        self._stays = False  # for agents that are not heard
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
        self._served: Mapping[str, Callable[[Any], Any]] = {
            "connect": self._connect,
            "upload": self._upload,
            "wait": self._wait,
            "send": self._send,
            "command": lambda command: radio.command(replace(command)),  # which checks it again
            "correct": radio.correct,
            "set_parameters": lambda message: radio.set_parameters(*message),
            "record_in": self._record_in,
            "close": self._close,
        }

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
                self._take(self._connection.recv())
        except (EOFError, OSError):
            self._gone = True
        self._watch(time.monotonic())

    def terminate(self) -> None:
        """Land all agents as soon as one flies; give up those not heard; for a signal handler."""
        self._terminated = True

    def _land(self, reason: str) -> None:
        """Land all agents, if any flies; from now on the flight cannot move them."""
        if self._descent is not None:
            return
        aloft = self._remaining()
        if not aloft:
            return
        self._descent = Descent(self._radio, self._scene, time.monotonic(), self._log)
        if flown := [row for row in aloft if not self._radio.vehicles[row].stopped]:
            self._log(f"{reason}: landing {self._scene.named(flown)}")
            self._problem = (f"the guardian lands all agents: {reason}", "plugin-failed")

    def _take(self, message: object) -> None:
        """Act on a message of the flight; others are left out."""
        match message:
            case (int() | None as number, str(name), argument) if name in self._served:
                self._handle(number, name, argument)
            case _:
                log.warning("guardian: a message is none of the flight's")

    def _handle(self, number: int | None, name: str, argument: Any) -> None:
        """Act on a message; it is answered if it has a number."""
        self._heard = time.monotonic()
        if self._hovers and self._descent is None:
            self._hovers = False
            self._log("the flight answers again")
        stops = isinstance(argument, Command) and argument.order is Order.STOP
        if self._descent is not None and name in MOVING and not stops:
            return
        value = None
        try:
            value = self._served[name](argument)
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
        if self._radio.began is not None:
            raise ContractError("the links are open")
        self._working(self._radio.connect, shown=False)

    def _upload(self, trajectories: Any) -> None:
        if self._remaining():  # it would not be flown meanwhile
            raise ContractError("trajectories are uploaded before the flight")
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
        began = self._radio.began
        passed = 0.0 if began is None else time.monotonic() - began
        self._radio.wait(min(passed + MAX_WAIT, until))
        return self._radio.began, self._radio.connected, self._radio.receive()

    def _send(self, message: tuple[Setpoint, Transform | None]) -> None:
        setpoint, to_map = message
        self._radio.send(setpoint)
        self._setpoint = setpoint
        if to_map is not None:
            self._to_map = to_map.where(to_map.known, self._to_map)

    def _record_in(self, folder: Path) -> None:
        self._folder = Path(folder)

    def _close(self, _none: None) -> list[int]:
        """Land all agents, and close the links if all are down.

        Returns:
            Rows of those that may be in the air, and are not heard: the guardian stays for them.
        """
        began = time.monotonic()
        self._end_flight(began, "the flight has ended")
        self._problem = None
        while self._is_landing() and time.monotonic() < began + LANDING_TIME:
            time.sleep(PERIOD)
            self._fly(time.monotonic())
        remaining = self._remaining()
        if not remaining:
            self._radio.close()
            self._ended = True
        return remaining

    def _remaining(self) -> list[int]:
        """Return the rows of the agents that may be in the air."""
        return np.flatnonzero(self._radio.aloft()).tolist()

    def _is_landing(self) -> bool:
        """Whether agents that are heard may be in the air."""
        if self._descent is None or self._descent.over:
            return False
        return bool((self._radio.aloft() & self._radio.heard()).any())

    def _watch(self, now: float) -> None:
        """Fly the agents if the flight does not."""
        silent = now - self._heard
        if self._over_since is None:
            if self._gone:
                self._end_flight(now, "the flight has ended without closing its links")
            elif self._terminated:
                self._land("SIGTERM")
            elif silent >= LAND_AFTER:
                self._land(f"no message of the flight for {silent:.2f} s")
        if self._descent is not None:
            self._fly(now)
        elif silent >= HOVER_AFTER and not self._gone:
            self._hover(silent)
        if self._over_since is not None:
            self._end(now - self._over_since)

    def _end_flight(self, now: float, reason: str) -> None:
        """Land all agents: the flight is over."""
        self._over_since, self._terminated = now, False
        self._land(reason)

    def _end(self, passed: float) -> None:
        """End `passed` s after the flight if all agents are down, or they have been given up."""
        if self._descent is None or self._descent.over:
            self._leave([])
            return
        waits = not self._is_landing()  # for links to return
        aloft = self._remaining()
        if passed >= self._landing_timeout or (waits and self._terminated):
            text = self._radio.describe(aloft)
            self._log(f"given up {passed:.0f} s after the flight, may be in the air: {text}")
            self._leave(aloft)
        elif waits and not self._stays:
            self._stays = True
            self._log(
                f"may be in the air: {self._radio.describe(aloft)}; landing as soon as heard, "
                f"for {self._landing_timeout:g} s; `kill {os.getpid()}` gives up"
            )
            self._detach()

    def _leave(self, aloft: list[int]) -> None:
        """End, and let the flight know which rows may be in the air, if it still waits."""
        self._ended = True
        with suppress(OSError, ValueError):
            self._connection.send(Answer(None, value=aloft))

    def _detach(self) -> None:
        """Release a pipe that standard error is: its reader waits for the end of that."""
        with suppress(OSError, ValueError):
            if not sys.stderr.isatty():
                with Path(os.devnull).open("w") as nowhere:
                    os.dup2(nowhere.fileno(), sys.stderr.fileno())

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
