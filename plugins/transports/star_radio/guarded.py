"""The transport ``radio`` with a guardian: the links are in a process that survives this one."""

from __future__ import annotations

import dataclasses
import logging
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn

import numpy as np

from star_core import (
    Command,
    Corrections,
    Order,
    PluginError,
    Scene,
    Setpoint,
    Telemetry,
    Trajectory,
    Transform,
    Truth,
)
from star_core.toolkit import Progress, on_terminal, python_process, shortlist
from star_core.toolkit import log as write
from star_radio import rescue
from star_radio.options import RadioOptions
from star_radio.report import flying
from star_radio.sensors import Sensors, connecting
from star_radio.takeoffs import ATTEMPTS, REPLY_TIME, WRITE_TIMEOUT

log = logging.getLogger(__name__)

TIMEOUT: Final = 0.7  # s, for an answer: 2 s after the last setpoint the motors stop, and the core
# interrupts a call after 1 s
START_TIMEOUT: Final = 30.0  # s, for the process to start, and between reports while connecting
CLOSE_TIMEOUT: Final = 60.0  # s, for landings that the guardian has begun, and for closing
EXIT_TIMEOUT: Final = 2.0  # s
UNATTENDED_TIME: Final = 10.0  # s, for which a flight without a terminal waits for landings
POLL_PERIOD: Final = 0.2  # s
LAST_TAKEOFF: Final = WRITE_TIMEOUT + ATTEMPTS * REPLY_TIME + 2.0
"""s after the command: 2 s after the last start that is sent, within which an agent reports to
fly."""


class Answer(NamedTuple):
    """An answer to a message.

    Attributes:
        number: Of the message; None for a report of progress.
        problem: Message and code of an error, also of earlier messages without an answer.
        value: What was asked for.
        lines: Log messages since the last answer, with their levels.
    """

    number: int | None
    problem: tuple[str, str] | None = None
    value: Any = None
    lines: Sequence[tuple[int, str]] = ()


class GuardedRadio:
    """Crazyflies through a guardian, which lands them if this process does not answer.

    Cameras and motion capture, which fly nothing, are received here.

    Raises:
        PluginError: The motion-capture system is not available.
    """

    def __init__(self, scene: Scene, options: RadioOptions) -> None:
        n = len(scene.agents)
        self._scene, self._options = scene, options
        self._sensors = Sensors(scene, options)
        self._number = 0
        self._lost = ""  # what happened to the guardian
        self._aloft = ""  # names of the drones for which the guardian stays
        self._rescue: threading.Thread | None = None
        self._progress = connecting(n, lambda: self._detail)
        self._detail = ""
        self._began = 0.0
        self._telemetry: Telemetry | None = None
        self._connected = np.zeros(n, np.bool_)
        self._taken_off = np.full(n, -np.inf)  # s, of the last command to take off
        self._stopped = np.zeros(n, np.bool_)  # whose motors were stopped
        self._to_map: Transform | None = None
        self._process, self._connection = python_process("star_radio.guardian")
        self._connection.send((scene, dataclasses.replace(options, cameras={}, mocap=None)))

    def connect(self) -> None:
        """Open all links, as `Radio` does."""
        with self._progress:
            self._call("connect", None, START_TIMEOUT)
        self._sensors.connect()

    def upload(self, trajectories: Sequence[Trajectory]) -> None:
        """Upload trajectories, as `Radio` does."""
        self._call("upload", trajectories, START_TIMEOUT)

    def record_in(self, folder: Path) -> None:
        """Let the guardian write what it does into ``guardian.log`` in a folder."""
        self._post("record_in", folder.absolute())

    def note_frames(self, map_from_odom: Transform) -> None:
        """Let the guardian know where the agents are, to keep them clear of each other."""
        self._to_map = map_from_odom

    def wait(self, until: float) -> float:
        patience = max(0.0, self._began + until - time.monotonic()) if self._began else until
        self._began, self._connected, self._telemetry = self._call(
            "wait", until, patience + TIMEOUT
        )
        return time.monotonic() - self._began

    def receive(self) -> Telemetry:
        telemetry = self._telemetry
        if telemetry is None:
            raise PluginError("receive() before wait()")
        odometry = dataclasses.replace(telemetry.odometry)  # read-only, as any table
        frames = self._sensors.frames(self._began)
        return dataclasses.replace(telemetry, odometry=odometry, frames=frames)

    def command(self, command: Command) -> None:
        self._stopped[command.agent] = command.order is Order.STOP
        if command.order is Order.TAKEOFF:
            self._taken_off[command.agent] = time.monotonic()
        self._post("command", command)

    def set_parameters(self, rows: Sequence[int], values: Mapping[str, float]) -> None:
        """Set parameters of agents, as `Radio` does."""
        self._post("set_parameters", (tuple(rows), dict(values)))

    def correct(self, corrections: Corrections) -> None:
        self._post("correct", corrections)

    def send(self, setpoint: Setpoint) -> Setpoint:
        """Send the active rows that are connected; only these are active in the return value."""
        active = setpoint.active & self._connected
        sent = setpoint
        if active.sum() != setpoint.active.sum():
            sent = dataclasses.replace(setpoint, active=active)
        self._post("send", (sent, self._to_map))
        return sent

    def truth(self) -> Truth | None:
        return self._sensors.truth(self._began) if self._began else None

    def close(self) -> None:
        """Let the guardian land flying drones and close the links; wait until it has.

        It stays for drones that may be in the air and are not heard; see `await_landings`.
        """
        remaining: list[int] = []
        try:
            if not (self._connection.closed or self._aloft):
                remaining = self._call("close", None, CLOSE_TIMEOUT)
        finally:
            self._aloft = self._aloft or self._scene.named(remaining)
            if not self._aloft:
                self._connection.close()  # which ends the guardian, too
                with suppress(subprocess.TimeoutExpired):
                    self._process.wait(EXIT_TIMEOUT)
            self._sensors.close()
            if self._rescue is not None:
                self._rescue.join()

    def await_landings(self) -> None:
        """Wait until the guardian has landed all drones, or has given them up.

        Ctrl-C gives them up. If stderr is no terminal it waits for `UNATTENDED_TIME` at most; the
        guardian goes on.
        """
        if not self._aloft:
            return
        began, pid = time.monotonic(), self._process.pid
        end = np.inf if on_terminal() else began + UNATTENDED_TIME

        def detail() -> str:
            return (
                f"landing as soon as heard, for {time.monotonic() - began:.0f} s; Ctrl-C gives up"
            )

        try:
            with Progress(f"{self._aloft} may be in the air", detail=detail, announced=True):
                while time.monotonic() < end and not self._connection.poll(POLL_PERIOD):
                    pass
            if time.monotonic() >= end:
                write(f"star: the guardian goes on landing {self._aloft}; `kill {pid}` gives up")
            elif not self._connection.recv().value:
                write(f"star: the guardian has landed {self._aloft}")
            else:
                write(f"star: given up, may be in the air: {self._aloft}")
        except (EOFError, OSError):
            write(f"star: the guardian has ended, may be in the air: {self._aloft}")
        except KeyboardInterrupt:
            self._process.terminate()
            write(f"star: given up, may be in the air: {self._aloft}; `star land` lands them")
            raise
        finally:
            self._aloft = ""
            self._connection.close()

    def _post(self, name: str, argument: object, number: int | None = None) -> None:
        """Send a message."""
        if self._lost:
            raise PluginError(self._lost, "link-failed")
        try:
            self._connection.send((number, name, argument))
        except OSError:
            self._lose("has ended")

    def _call(self, name: str, argument: object, patience: float) -> Any:
        """Send a message and return the answer, within `patience`, s, or after its last report."""
        self._number += 1
        self._post(name, argument, self._number)
        try:
            while self._connection.poll(patience):
                answer: Answer = self._connection.recv()
                for level, line in answer.lines:
                    log.log(level, "%s", line)
                if answer.number is None:
                    self._progress.done, self._detail = answer.value
                elif answer.number == self._number:  # not of a call that was interrupted
                    if answer.problem is not None:
                        raise PluginError(*answer.problem)
                    return answer.value
        except (EOFError, OSError):
            self._lose("has ended")
        return self._lose(f"does not answer for {patience:.1f} s")

    def _lose(self, how: str) -> NoReturn:
        """Land the agents through links of this process: the guardian is lost."""
        self._process.kill()
        self._process.wait()  # its links are closed
        self._connection.close()
        text = self._lost = f"the guardian process {how}"
        if drones := self._airborne():
            text += f": landing {shortlist(drone.name for drone in drones)} without reports"
            # in a thread: it must not be interrupted, as this call may be
            self._rescue = threading.Thread(target=rescue.land, args=(drones, self._options.udp))
            self._rescue.start()
        raise PluginError(text, "link-failed")

    def _airborne(self) -> list[rescue.Airborne]:
        """Return the agents in the air, by the last telemetry and the last commands."""
        telemetry = self._telemetry
        if telemetry is None:
            return []
        height = telemetry.position[:, 2]
        flies = flying(telemetry.state, height)
        flies |= time.monotonic() - self._taken_off < LAST_TAKEOFF
        agents = self._scene.agents
        return [
            rescue.Airborne(agents[row].name, agents[row].uri or "", float(height[row]))
            for row in np.flatnonzero(flies & self._connected & ~self._stopped).tolist()
        ]
