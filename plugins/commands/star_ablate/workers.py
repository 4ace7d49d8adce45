"""Flies runs in parallel, in several independent processes.

`concurrent.futures.ProcessPoolExecutor` is not used: when one of its processes dies it aborts all
pending runs, and does not report which one caused it or how it died.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from multiprocessing import connection, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Final

from star_ablate.flight import THREADS, Result, Task, serve

SPAWN: Final = get_context("spawn")
LOOK: Final = 0.2  # s, interval of checks whether to stop
PATIENCE: Final = 5.0
"""Time a process gets to end by itself, s."""


def fly_all(
    tasks: Sequence[Task],
    workers: int,
    output: Path,
    time_limit: float | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Generator[tuple[int, Result]]:
    """Yield the index and result of every task, in order of completion.

    All processes have ended when the iterator is exhausted or closed.

    Args:
        tasks: Tasks to fly.
        workers: Number of processes.
        output: File for the output of the processes.
        time_limit: Wall time limit of a task, s.
        stopped: Polled; whether to skip the remaining tasks.
    """
    waiting = iter(enumerate(tasks))
    crew = [Worker(output, time_limit) for _ in range(min(workers, len(tasks)))]
    try:
        for worker in crew:
            worker.give(*next(waiting))
        while busy := {worker.connection: worker for worker in crew if worker.busy}:
            if stopped():
                return
            soonest = min(LOOK, *(worker.left() for worker in busy.values()))
            ready = connection.wait(list(busy), soonest)
            for worker in busy.values():
                if worker.connection not in ready and worker.left() > 0:
                    continue
                done = worker.take()
                if (following := next(waiting, None)) is not None:
                    worker.give(*following)
                yield done
    finally:
        for worker in crew:
            worker.end()


class Worker:
    """A process that flies one task after the other; it is replaced when it dies.

    Args:
        output: File for its output.
        time_limit: Wall time limit of a task, s.

    Attributes:
        connection: Readable when a task is done or the process has ended.
        busy: Whether a task is running.
    """

    def __init__(self, output: Path, time_limit: float | None) -> None:
        self._output = output
        self._limit = float("inf") if time_limit is None else time_limit
        self._index = 0
        self._begun = 0.0
        self.busy = False
        self._process: BaseProcess | None = None

    def give(self, index: int, task: Task) -> None:
        """Start a task."""
        if self._process is None:
            self._start()
        try:
            self.connection.send(task)
        except OSError:  # it died after the previous task; this task did not cause it
            self._kill()
            self._start()
            self.connection.send(task)
        self._index, self._begun, self.busy = index, time.monotonic(), True

    def take(self) -> tuple[int, Result]:
        """Return the index of the task and its result.

        Call it when `connection` is readable or the time is up; in that case the process is killed.
        """
        self.busy = False
        if self.left() > 0 or self.connection.poll():
            try:
                result: Result = self.connection.recv()
            except (EOFError, OSError):
                self._join()
                result = self._crashed("its process ended with {}")
        else:
            result = self._crashed(f"took longer than {self._limit:g} s")
        return self._index, result

    def left(self) -> float:
        """Remaining time of the task, s."""
        return max(0.0, self._begun + self._limit - time.monotonic())

    def end(self) -> None:
        """End the process: immediately if it is busy, otherwise gracefully."""
        if self._process is None or self._process.pid is None:
            return
        if not self.busy:
            self.connection.close()
            self._join()
        if self._process.exitcode is None:
            self._kill()

    def _start(self) -> None:
        self.connection, theirs = SPAWN.Pipe()
        self._process = process = SPAWN.Process(target=serve, args=(theirs, self._output))
        for name in THREADS:  # read when a library is loaded, so set before the process starts
            os.environ.setdefault(name, "1")
        process.start()
        theirs.close()  # so that this end reads EOF when the process ends

    def _join(self) -> None:
        """Wait for the process to end by itself."""
        if self._process is not None:
            self._process.join(PATIENCE)

    def _crashed(self, why: str) -> Result:
        wall_time = time.monotonic() - self._begun
        status = self._kill()
        how = signal.Signals(-status).name if status < 0 else f"exit status {status}"
        return Result("crashed", why.format(how), wall_time, None)

    def _kill(self) -> int:
        """Kill the process and all its children; return its exit status."""
        process, self._process = self._process, None
        if process is None or process.pid is None:
            return 0
        with suppress(ProcessLookupError, PermissionError):  # it has not become a group yet
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        process.join()
        self.connection.close()
        return process.exitcode or 0
