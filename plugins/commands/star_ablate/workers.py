"""Flies runs at the same time, each in one of several processes that outlive each other.

`concurrent.futures.ProcessPoolExecutor` is not used: when one of its processes dies it gives up
all runs under way, and does not tell which one was to blame or how it died.
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
LOOK: Final = 0.2  # s between two looks at whether to stop
PATIENCE: Final = 5.0
"""How long a process may take to end by itself, s."""


def fly_all(
    tasks: Sequence[Task],
    workers: int,
    output: Path,
    time_limit: float | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Generator[tuple[int, Result]]:
    """Yield the index and result of every task, in the order in which they are done.

    All processes have ended when the iterator is exhausted or closed.

    Args:
        tasks: What to fly.
        workers: How many at the same time.
        output: The file to which the processes print.
        time_limit: Wall time that a task may take, s.
        stopped: Asked again and again whether to leave the rest unflown.
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
    """A process that flies one task after the other; another one takes its place when it dies.

    Args:
        output: The file to which it prints.
        time_limit: Wall time that a task may take, s.

    Attributes:
        connection: Can be read when a task is done, or will never be.
        busy: Whether there is a task to be done.
    """

    def __init__(self, output: Path, time_limit: float | None) -> None:
        self._output = output
        self._limit = float("inf") if time_limit is None else time_limit
        self._index = 0
        self._begun = 0.0
        self.busy = False
        self._process: BaseProcess | None = None

    def give(self, index: int, task: Task) -> None:
        """Begin with a task."""
        if self._process is None:
            self._start()
        try:
            self.connection.send(task)
        except OSError:  # it died after the task before, which is none of this one's fault
            self._kill()
            self._start()
            self.connection.send(task)
        self._index, self._begun, self.busy = index, time.monotonic(), True

    def take(self) -> tuple[int, Result]:
        """Return the index of the task and what came of it.

        To be called when `connection` can be read or no time is left; then the process is ended.
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
        """How long the task may still take, s."""
        return max(0.0, self._begun + self._limit - time.monotonic())

    def end(self) -> None:
        """End the process: at once if it is busy, else in its own time."""
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
        for name in THREADS:  # read when a library is loaded, so before the process is there
            os.environ.setdefault(name, "1")
        process.start()
        theirs.close()  # so that its end can be read when the process is gone

    def _join(self) -> None:
        """Let the process end by itself."""
        if self._process is not None:
            self._process.join(PATIENCE)

    def _crashed(self, why: str) -> Result:
        wall_time = time.monotonic() - self._begun
        status = self._kill()
        how = signal.Signals(-status).name if status < 0 else f"exit status {status}"
        return Result("crashed", why.format(how), wall_time, None)

    def _kill(self) -> int:
        """End the process and all that it started, if they have not; return its exit status."""
        process, self._process = self._process, None
        if process is None or process.pid is None:
            return 0
        with suppress(ProcessLookupError, PermissionError):  # it has not become a group yet
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        process.join()
        self.connection.close()
        return process.exitcode or 0
