"""Flies runs in parallel, in several independent processes.

`concurrent.futures.ProcessPoolExecutor` is not used: when one of its processes dies it aborts all
pending runs, and does not report which one caused it or how it died.
"""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from multiprocessing import connection, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Final

from star_ablate.flight import Job, Result, serve

SPAWN: Final = get_context("spawn")
POLL_INTERVAL: Final = 0.2  # s, between checks whether to stop
EXIT_TIMEOUT: Final = 5.0  # s, in which a process ends by itself
ONE_THREAD: Final = dict.fromkeys(  # there are as many workers as cores
    ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1"
)

KILL_AT_EOF: Final = "read line; kill -9 -$0 $0"
"""Script that kills a process and its group, its argument, when the writer of its input has ended,
whatever ended it, and whatever that process computes."""


def fly_all(
    jobs: Sequence[Job],
    workers: int,
    output: Path,
    time_limit: float | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Generator[tuple[int, Result]]:
    """Yield the index and result of every job, in order of completion.

    All processes have ended when the iterator is exhausted or closed.

    Args:
        jobs: Runs to fly.
        workers: Number of processes.
        output: File for the output of the processes.
        time_limit: Wall time limit of a run, s.
        stopped: Polled; whether to skip the remaining jobs.
    """
    waiting = iter(enumerate(jobs))
    pool = [Worker(output, time_limit) for _ in range(min(workers, len(jobs)))]
    try:
        for worker in pool:
            worker.begin(*next(waiting))
        while busy := {worker.connection: worker for worker in pool if worker.busy}:
            if stopped():
                return
            soonest = min(POLL_INTERVAL, *(worker.remaining() for worker in busy.values()))
            ready = connection.wait(list(busy), soonest)
            for worker in busy.values():
                if worker.connection not in ready and worker.remaining() > 0:
                    continue
                done = worker.finish()
                if (following := next(waiting, None)) is not None:
                    worker.begin(*following)
                yield done
    finally:
        for worker in pool:
            worker.end()


class Worker:
    """A process that flies one job after the other; it is replaced when it dies.

    Args:
        output: File for its output.
        time_limit: Wall time limit of a job, s.

    Attributes:
        connection: Readable when a job is done or the process has ended.
        busy: Whether a job is running.
    """

    def __init__(self, output: Path, time_limit: float | None) -> None:
        self._output = output
        self._limit = float("inf") if time_limit is None else time_limit
        self._index = 0
        self._begun = 0.0
        self.busy = False
        self._process: BaseProcess | None = None
        self._guard: subprocess.Popen[bytes] | None = None

    def begin(self, index: int, job: Job) -> None:
        """Start a job."""
        if self._process is None:
            self._start()
        try:
            self.connection.send(job)
        except OSError:  # it died after the previous job; this job did not cause it
            self._kill()
            self._start()
            self.connection.send(job)
        self._index, self._begun, self.busy = index, time.monotonic(), True

    def finish(self) -> tuple[int, Result]:
        """Return the index of the job and its result.

        Call it when `connection` is readable or the time is up; in that case the process is killed.
        """
        self.busy = False
        if self.remaining() <= 0 and not self.connection.poll():
            return self._index, self._crashed(f"took longer than {self._limit:g} s")
        try:
            result: Result = self.connection.recv()
        except (EOFError, OSError):
            if self._process is not None:
                self._process.join(EXIT_TIMEOUT)
            result = self._crashed("its process ended with {}")
        return self._index, result

    def remaining(self) -> float:
        """Remaining time of the job, s."""
        return max(0.0, self._begun + self._limit - time.monotonic())

    def end(self) -> None:
        """End the process: immediately if it is busy, otherwise gracefully."""
        if self._process is None or self._process.pid is None:
            return
        if not self.busy:
            self.connection.close()
            self._process.join(EXIT_TIMEOUT)
        if self._process.exitcode is None:
            self._kill()
        self._dismiss_guard()

    def _start(self) -> None:
        self.connection, theirs = SPAWN.Pipe()
        self._process = process = SPAWN.Process(target=serve, args=(theirs, self._output))
        for name, value in ONE_THREAD.items():  # libraries read it when they are loaded
            os.environ.setdefault(name, value)
        process.start()
        theirs.close()  # so that this end reads EOF when the process ends
        self._guard = subprocess.Popen(  # noqa: S603 -- its argument is a number
            ["/bin/sh", "-c", KILL_AT_EOF, str(process.pid)],
            stdin=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

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
        self._dismiss_guard()
        self.connection.close()
        return process.exitcode or 0

    def _dismiss_guard(self) -> None:
        if self._guard is not None:
            self._guard.kill()
            self._guard.communicate()
            self._guard = None
