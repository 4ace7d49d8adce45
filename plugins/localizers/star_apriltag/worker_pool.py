"""Estimates agents' states beside the tick, in processes of their own.

A tick never waits for an image. The analysis holds the interpreter's lock, so threads would not do.
"""

from __future__ import annotations

import faulthandler
import logging
import os
import signal
import subprocess
import sys
import traceback
from contextlib import suppress
from logging.handlers import QueueHandler
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Final, NamedTuple

from star_apriltag.agent_estimator import Settings
from star_apriltag.agent_group import AgentGroup, TickInput, TickOutput, merged
from star_core import Scene
from star_core.toolkit import python_process

log = logging.getLogger(__name__)

THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
EXIT_TIMEOUT: Final = 5.0  # s, for a process to end by itself
MAX_IMAGE_AGE: Final = 1.0  # s: a process that is later than that does not get older images


class WorkerPool:
    """Estimates the states of all agents of a scene.

    In lock-step, the result of an image is used in the tick after the one at which it arrived, and
    awaited if necessary: a flight is the same with any number of processes. In real time it is used
    in the first tick after it is ready.

    Args:
        scene: Agents with their cameras, the map.
        settings: Options.
        processes: Number of processes; with 0, states are estimated within the tick.

    Attributes:
        lost: Rows of agents whose process has ended.
    """

    def __init__(self, scene: Scene, settings: Settings, processes: int) -> None:
        rows = sorted(range(len(scene.agents)), key=lambda row: scene.agents[row].camera is None)
        self.lost: list[int] = []
        self._workers: list[LocalWorker | RemoteWorker] = []
        self._wait = not scene.realtime
        if not processes:
            self._workers.append(LocalWorker(scene, rows, settings))
            return
        try:
            for i in range(min(processes, len(rows))):
                self._workers.append(RemoteWorker(scene, rows[i::processes], settings))
            for worker in self._workers if scene.realtime else ():
                worker.receive(wait=True)  # so that the first images need not wait for imports
        except BaseException:
            self.close()
            raise

    def update(self, reports: TickInput) -> TickOutput:
        """Process the reports of one tick; return new results of earlier ones."""
        output = merged([worker.receive(wait=self._wait) for worker in self._workers])
        for worker in self._workers:
            worker.send(reports)
        self.lost = [row for worker in self._workers if worker.ended for row in worker.rows]
        return output

    def close(self) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.close()


def default_processes(scene: Scene) -> int:
    """Return a number of processes that suits a scene and this machine.

    ``OMP_NUM_THREADS=1`` means, as for other libraries, that one core is available.
    """
    cameras = sum(agent.camera is not None for agent in scene.agents)
    limit = os.environ.get("OMP_NUM_THREADS", "")
    cores = min(_cores(), int(limit) if limit.isdecimal() else sys.maxsize)
    return min(cameras, max(1, cores - 1)) if cores > 1 or scene.realtime else 0


class LocalWorker:
    """Estimates states in this process."""

    ended = False

    def __init__(self, scene: Scene, rows: list[int], settings: Settings) -> None:
        self.rows = rows
        self._group = AgentGroup(scene, rows, settings)
        self._output = TickOutput()

    def receive(self, *, wait: bool) -> TickOutput:
        """Return the results of the last tick."""
        return self._output

    def send(self, reports: TickInput) -> None:
        """Process a tick."""
        self._output = self._group.update(reports)

    def close(self) -> None:
        """Do nothing."""


class RemoteWorker:
    """Estimates states in another process.

    Input is sent only after the process has answered, so that sending never waits. `ended` is set
    when the process has ended unexpectedly.
    """

    def __init__(self, scene: Scene, rows: list[int], settings: Settings) -> None:
        self.rows = rows
        self.ended = False
        self._names = scene.named(rows)
        self._pending: list[TickInput] = []
        self._busy = True  # until it has imported
        threads = dict.fromkeys(THREADS, "1")
        self._process, self._connection = python_process("star_apriltag.worker_pool", **threads)
        self._connection.send((scene, rows, settings))

    def receive(self, *, wait: bool) -> TickOutput:
        """Return the results of the last input if the process has answered, or wait for them.

        Raises:
            RuntimeError: The process failed; the message is its traceback.
        """
        if self.ended or not self._busy or not (wait or self._connection.poll()):
            return TickOutput()
        try:
            answer = self._connection.recv()
        except (EOFError, OSError):
            self._report_end()
            return TickOutput()
        self._busy = False
        if isinstance(answer, str):
            raise RuntimeError(f"estimating {self._names} failed:\n{answer}")  # noqa: TRY004
        for record in answer.log:
            logger = logging.getLogger(record.name)
            if logger.isEnabledFor(record.levelno):
                logger.handle(record)
        output: TickOutput = answer.output
        return output

    def send(self, reports: TickInput) -> None:
        """Send a tick, or keep it until the process is ready."""
        if self.ended:
            return
        self._pending.append(reports.of(self.rows))
        if self._busy:
            self._pending = [
                old if reports.time - old.time <= MAX_IMAGE_AGE else old._replace(images=())
                for old in self._pending
            ]
            return
        try:
            self._connection.send(self._pending)
        except OSError:
            self._report_end()
            return
        self._pending, self._busy = [], True

    def close(self) -> None:
        """End the process: by closing its connection, or by a signal if it does not respond."""
        self._connection.close()
        try:
            self._process.wait(EXIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _report_end(self) -> None:
        self.ended = True
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(EXIT_TIMEOUT)
        status = self._process.returncode
        signaled = status is not None and status < 0
        how = signal.Signals(-status).name if signaled else f"exit status {status}"
        log.error("the process that estimates %s has ended with %s", self._names, how)


class Answer(NamedTuple):
    """Answer of a process to some ticks."""

    output: TickOutput
    log: tuple[logging.LogRecord, ...] = ()  # messages that were logged meanwhile


def serve(descriptor: int) -> None:
    """Estimate states until the connection of an inherited descriptor is closed.

    It transmits the arguments of `AgentGroup`, then lists of `TickInput`, and each is answered with
    an `Answer`. After a failure the answer is the traceback.
    """
    faulthandler.enable()
    connection = Connection(descriptor)
    logger, records = logging.getLogger("star_apriltag"), SimpleQueue[logging.LogRecord]()
    logger.addHandler(QueueHandler(records))
    logger.setLevel(logging.INFO)
    try:
        group = AgentGroup(*connection.recv())
        connection.send(Answer(TickOutput()))
        while True:
            ticks = connection.recv()
            output = merged([group.update(reports) for reports in ticks])
            messages = tuple(records.get() for _ in range(records.qsize()))
            connection.send(Answer(output, messages))
    except (EOFError, OSError):  # the parent has ended
        return
    except Exception:  # noqa: BLE001 -- the parent reports it
        connection.send(traceback.format_exc())


def _cores() -> int:
    """Return the number of cores that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
